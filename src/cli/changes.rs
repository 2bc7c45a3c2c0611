//! `--edit NAME` and `--set KEY=VALUE`: which edits a command makes, in the order given.

use anyhow::{Result, anyhow};
use clap::{Arg, ArgAction, ArgMatches, Args, Command, FromArgMatches};
use photogram::scene::Scene;
use photogram::volume::Volume;

/// The edits that are asked for. Clap keeps the order within each of two options; this keeps it
/// between them as well.
pub struct Changes(Vec<Change>);

enum Change {
    /// A named edit of the scene.
    Edit(String),
    /// One that the command line says.
    Set(String),
}

impl Args for Changes {
    fn augment_args(command: Command) -> Command {
        let repeated = |id: &'static str| Arg::new(id).long(id).action(ArgAction::Append);
        let edit = "A named edit of the scene; may be repeated";
        let set = "A change: MATERIAL.FIELD=VALUE, LIGHT.FIELD=VALUE, camera.FIELD=VALUE or \
                   background=VALUE, such as bone.albedo=0.9,0.6,0.2; may be repeated, and is made \
                   in the order given, also among --edit";
        command
            .arg(repeated("edit").value_name("NAME").help(edit))
            .arg(repeated("set").value_name("KEY=VALUE").help(set))
    }

    fn augment_args_for_update(command: Command) -> Command {
        Self::augment_args(command)
    }
}

impl FromArgMatches for Changes {
    fn from_arg_matches(matches: &ArgMatches) -> std::result::Result<Self, clap::Error> {
        let given = |id: &str, change: fn(String) -> Change| -> Vec<(usize, Change)> {
            let values = matches.get_many::<String>(id).into_iter().flatten();
            let places = matches.indices_of(id).into_iter().flatten();
            places.zip(values.map(|v| change(v.clone()))).collect()
        };
        let mut all = given("edit", Change::Edit);
        all.extend(given("set", Change::Set));
        all.sort_by_key(|(place, _)| *place);
        Ok(Self(all.into_iter().map(|(_, change)| change).collect()))
    }

    fn update_from_arg_matches(
        &mut self,
        matches: &ArgMatches,
    ) -> std::result::Result<(), clap::Error> {
        *self = Self::from_arg_matches(matches)?;
        Ok(())
    }
}

impl Changes {
    /// Adds to the scene's edits what the command line says, each as it fits what the edits before
    /// it leave; returns the names of all edits to make.
    pub fn add_to(&self, scene: &mut Scene) -> Result<Vec<String>> {
        let mut now = scene.clone();
        let mut names = Vec::new();
        for change in &self.0 {
            let name = match change {
                Change::Edit(name) => name.clone(),
                Change::Set(text) => {
                    let edit = now.edit_of(text).map_err(|e| anyhow!("--set {e}"))?;
                    scene.edits.push(edit.clone());
                    now.edits.push(edit.clone());
                    edit.name
                }
            };
            now = now.edited(&name)?;
            names.push(name);
        }
        Ok(names)
    }
}

/// Settles the scene so that its majorant covers the edits in the order of `names`, too: what the
/// scene itself foresees is each edit alone, and all of them.
pub fn settle(scene: &mut Scene, names: &[String], volume: &Volume) {
    let mut asked = scene.clone();
    let edit = |name: &String| scene.edits.iter().find(|e| e.name == *name).cloned();
    asked.edits = names.iter().filter_map(edit).collect();
    asked.settle(volume);
    let is_given = scene.settings.majorant.is_some();
    scene.settle(volume);
    let majorant = &mut scene.settings.majorant;
    if !is_given {
        *majorant = majorant.zip(asked.settings.majorant).map(|(a, b)| a.max(b));
    }
}
