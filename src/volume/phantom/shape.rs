//! Signed distances in mm, negative inside; exact near the surface, where they
//! are looked at.

use glam::Vec3;

/// A shape by its signed distance.
pub(super) enum Shape {
    /// Round segments through points, each with its radius.
    Tube(Vec<(Vec3, f32)>),
    /// Along the world's axes.
    Ellipsoid { centre: Vec3, radii: Vec3 },
    /// Along the world's axes, its edges rounded.
    Block { centre: Vec3, half: Vec3, round: f32 },
    /// A cylinder with flat ends.
    Rod { ends: [Vec3; 2], radius: f32 },
    /// A union whose creases are filled over some mm.
    Blend(Vec<Shape>, f32),
}

impl Shape {
    pub fn tube(points: impl IntoIterator<Item = ([f32; 3], f32)>) -> Self {
        Self::Tube(points.into_iter().map(|(p, r)| (p.into(), r)).collect())
    }

    pub fn ellipsoid(centre: [f32; 3], radii: [f32; 3]) -> Self {
        Self::Ellipsoid { centre: centre.into(), radii: radii.into() }
    }

    /// A block by two corners.
    pub fn block(low: [f32; 3], high: [f32; 3], round: f32) -> Self {
        let [low, high] = [Vec3::from(low), Vec3::from(high)];
        Self::Block { centre: 0.5 * (low + high), half: 0.5 * (high - low), round }
    }

    pub fn rod(from: [f32; 3], to: [f32; 3], radius: f32) -> Self {
        Self::Rod { ends: [from.into(), to.into()], radius }
    }

    pub fn distance(&self, p: Vec3) -> f32 {
        match self {
            Self::Tube(points) => points
                .windows(2)
                .map(|ends| segment(p, ends[0], ends[1]))
                .fold(f32::INFINITY, f32::min),
            Self::Ellipsoid { centre, radii } => {
                let unit = (p - centre) / radii;
                let (length, slope) = (unit.length(), (unit / radii).length());
                if slope == 0.0 { -radii.min_element() } else { length * (length - 1.0) / slope }
            }
            Self::Block { centre, half, round } => {
                beyond((p - centre).abs() - half + *round) - round
            }
            Self::Rod { ends: [a, b], radius } => {
                let length = (b - a).length();
                let axis = (b - a) / length;
                let along = (p - a).dot(axis);
                let across = (p - a - along * axis).length();
                beyond(Vec3::new(
                    across - radius,
                    (along - 0.5 * length).abs() - 0.5 * length,
                    f32::MIN,
                ))
            }
            Self::Blend(parts, fill) => {
                parts.iter().map(|part| part.distance(p)).fold(f32::INFINITY, |a, b| {
                    let near = (1.0 - (a - b).abs() / fill).max(0.0);
                    a.min(b) - 0.25 * fill * near * near
                })
            }
        }
    }

    /// Two corners of a box around it.
    pub fn bounds(&self) -> [Vec3; 2] {
        match self {
            Self::Tube(points) => hull(points.iter().map(|&(p, r)| [p - r, p + r])),
            Self::Ellipsoid { centre, radii } => [centre - radii, centre + radii],
            Self::Block { centre, half, .. } => [centre - half, centre + half],
            Self::Rod { ends: [a, b], radius } => {
                hull([*a, *b].map(|p| [p - *radius, p + *radius]))
            }
            Self::Blend(parts, fill) => {
                let [low, high] = hull(parts.iter().map(Self::bounds));
                [low - *fill, high + *fill]
            }
        }
    }
}

fn hull(boxes: impl IntoIterator<Item = [Vec3; 2]>) -> [Vec3; 2] {
    let nothing = [Vec3::INFINITY, Vec3::NEG_INFINITY];
    boxes.into_iter().fold(nothing, |[low, high], [a, b]| [low.min(a), high.max(b)])
}

/// Distance to a segment less its radius, which runs linearly.
fn segment(p: Vec3, (a, ra): (Vec3, f32), (b, rb): (Vec3, f32)) -> f32 {
    let (to, along) = (p - a, b - a);
    let t = (to.dot(along) / along.length_squared()).clamp(0.0, 1.0);
    (to - t * along).length() - (ra + t * (rb - ra))
}

/// Distance to the region where all components are negative.
fn beyond(q: Vec3) -> f32 {
    q.max(Vec3::ZERO).length() + q.max_element().min(0.0)
}
