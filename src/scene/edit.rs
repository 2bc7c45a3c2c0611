//! Edits: named changes to a scene.

use glam::DVec3;

use super::{Camera, CameraPlace, Light, LightKind, Material, Scene};
use crate::error::{Error, Result};

/// A named set of changes, made together.
#[derive(Clone, Debug, PartialEq)]
pub struct Edit {
    /// Unique in the scene.
    pub name: String,
    /// What changes.
    pub changes: Changes,
}

/// What an edit changes, made in the order of the fields: first what is removed, then
/// what is added, then what is set. Empty fields change nothing.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Changes {
    /// Materials that go, by name.
    pub remove_materials: Vec<String>,
    /// Materials that come, at the end of the list.
    pub add_materials: Vec<Material>,
    /// Materials that change.
    pub materials: Vec<MaterialChange>,
    /// Lights that go, by name.
    pub remove_lights: Vec<String>,
    /// Lights that come, at the end of the list.
    pub add_lights: Vec<Light>,
    /// Lights that change.
    pub lights: Vec<LightChange>,
    /// The camera; the image keeps its size.
    pub camera: CameraChange,
    /// The new background, W/(sr mm²).
    pub background: Option<DVec3>,
}

/// Fields of a material that change; see [`Material`] for units and ranges.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MaterialChange {
    /// The material.
    pub name: String,
    /// New ramp.
    pub ramp: Option<Vec<[f64; 2]>>,
    /// New extinction, 1/mm.
    pub extinction: Option<f64>,
    /// New scatter.
    pub scatter: Option<f64>,
    /// New colour.
    pub colour: Option<DVec3>,
    /// New emission, radiance per mm.
    pub emission: Option<DVec3>,
    /// New Henyey-Greenstein g.
    pub phase_g: Option<f64>,
}

/// What changes of a light. Its id and share stay: they decide the photons' numbers.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LightChange {
    /// The light.
    pub name: String,
    /// New intensity, irradiance or radiance.
    pub emitted: Option<DVec3>,
    /// New place, of the same shape (a point stays a point).
    pub kind: Option<LightKind>,
}

/// What changes of the camera.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct CameraChange {
    /// New place.
    pub place: Option<CameraPlace>,
    /// New up vector.
    pub up: Option<DVec3>,
    /// New horizontal field of view, degrees.
    pub fov_deg: Option<f64>,
}

impl Scene {
    /// The scene after its own edit `name`.
    ///
    /// # Errors
    /// [`Error::Setting`] where there is no such edit, or it does not fit the scene.
    pub fn edited(&self, name: &str) -> Result<Self> {
        let edit = find(&self.edits, |e| &e.name, name, "edit")?;
        let mut scene = self.clone();
        scene.apply(&self.edits[edit])?;
        Ok(scene)
    }

    /// The scene as it stands, without the edits that it lists: what was made may not be made again.
    pub fn without_edits(&self) -> Self {
        Self { edits: Vec::new(), ..self.clone() }
    }

    /// Makes an edit. The majorant and the flux unit stay as they are.
    ///
    /// # Errors
    /// [`Error::Setting`] where the edit does not fit (an unknown name, an impossible
    /// value); the scene is then left unchanged.
    pub fn apply(&mut self, edit: &Edit) -> Result<()> {
        let mut next = self.clone();
        next.change(&edit.changes)
            .and_then(|()| next.check())
            .map_err(|e| Error::setting(format!("edit `{}`: {e}", edit.name)))?;
        *self = next;
        Ok(())
    }

    fn change(&mut self, changes: &Changes) -> Result<()> {
        for name in &changes.remove_materials {
            let at = find(&self.materials, |m| &m.name, name, "material")?;
            self.materials.remove(at);
        }
        self.materials.extend_from_slice(&changes.add_materials);
        for change in &changes.materials {
            let at = find(&self.materials, |m| &m.name, &change.name, "material")?;
            change.apply(&mut self.materials[at]);
        }
        for name in &changes.remove_lights {
            let at = find(&self.lights, |l| &l.name, name, "light")?;
            self.lights.remove(at);
        }
        self.lights.extend_from_slice(&changes.add_lights);
        for change in &changes.lights {
            let at = find(&self.lights, |l| &l.name, &change.name, "light")?;
            change.apply(&mut self.lights[at])?;
        }
        changes.camera.apply(&mut self.camera);
        set(&mut self.background, changes.background);
        Ok(())
    }
}

impl MaterialChange {
    pub(super) fn apply(&self, material: &mut Material) {
        set(&mut material.ramp, self.ramp.clone());
        set(&mut material.extinction, self.extinction);
        set(&mut material.scatter, self.scatter);
        set(&mut material.colour, self.colour);
        set(&mut material.emission, self.emission);
        set(&mut material.phase_g, self.phase_g);
    }
}

impl LightChange {
    fn apply(&self, light: &mut Light) -> Result<()> {
        if let Some(kind) = self.kind
            && kind.shape() != light.kind.shape()
        {
            return Err(Error::setting(format!(
                "light `{}` is a {} and cannot become a {}: remove it and add another",
                self.name,
                light.kind.shape(),
                kind.shape()
            )));
        }
        set(&mut light.kind, self.kind);
        set(&mut light.emitted, self.emitted);
        Ok(())
    }
}

impl CameraChange {
    pub(super) fn apply(&self, camera: &mut Camera) {
        set(&mut camera.place, self.place);
        set(&mut camera.up, self.up);
        set(&mut camera.fov_deg, self.fov_deg);
    }
}

/// Sets a field where there is something to set.
pub(super) fn set<T>(field: &mut T, value: Option<T>) {
    if let Some(value) = value {
        *field = value;
    }
}

/// Position of the item called `wanted`; the error lists the names there are.
fn find<T>(items: &[T], name: fn(&T) -> &String, wanted: &str, kind: &str) -> Result<usize> {
    items.iter().position(|i| name(i) == wanted).ok_or_else(|| {
        let names: Vec<&str> = items.iter().map(|i| name(i).as_str()).collect();
        Error::setting(unknown(kind, wanted, &names))
    })
}

/// What to say of a name that nothing has.
pub(super) fn unknown(kind: &str, wanted: &str, names: &[&str]) -> String {
    match names {
        [] => format!("no {kind} is called `{wanted}`: there is none at all"),
        _ => format!("no {kind} is called `{wanted}`: there is {}", names.join(", ")),
    }
}
