//! What every flight and every segment relied on, computed plainly on the host in f64.
//! Where rounding may decide (a value at an entry's edge, a point at a cell's), either
//! answer satisfies it.

use glam::{DVec3, UVec3};
use photogram::scene::{Filter, Scene};
use photogram::update::PhotonFrame;
use photogram::volume::Volume;

use super::snapshot::Snapshot;

const ENTRIES: f64 = 4096.0;
const LAYERS: u32 = 8;
const MACRO_CELL: f64 = 8.0;
/// Where an answer closer than this to a border is not asked for, mm.
const CLOSE: f64 = 2e-3;
const FOR_FLIGHT: u32 = 0x20;

pub struct Oracle<'a> {
    volume: &'a Volume,
    scene: &'a Scene,
    frame: &'a PhotonFrame,
    spacing: DVec3,
    extent: DVec3,
}

/// What was found of slots and of segments.
#[derive(Debug, Default)]
pub struct Found {
    /// Masks that lack a bit.
    pub missing: [u64; 2],
    /// Masks that were judged.
    pub relied_on: [u64; 2],
    /// Bits that masks have, and that they need.
    pub bits: [[u64; 2]; 2],
    /// Bits that some mask cannot do without.
    pub needed: [u64; 2],
}

impl Found {
    /// How many times the bits that they need masks have.
    pub fn excess(&self) -> [f64; 2] {
        self.bits.map(|[has, needs]| has as f64 / needs as f64)
    }

    /// Judges a mask by the values that it must contain: any bit of each.
    fn judge(&mut self, which: usize, mask: u64, values: &[u64]) {
        let missing = values.iter().any(|&any| mask & any == 0);
        self.missing[which] += u64::from(missing);
        self.relied_on[which] += u64::from(!values.is_empty());
        let least = values.iter().fold(0, |m, any| m | any & any.wrapping_neg());
        self.bits[which][0] += u64::from(mask.count_ones());
        self.bits[which][1] += u64::from(least.count_ones());
        let single = values.iter().filter(|any| any.is_power_of_two());
        self.needed[which] |= single.fold(0, |m, bit| m | bit);
    }
}

/// Jarzynski and Olano's pcg4d.
fn pcg4d(key: [u32; 4]) -> [u32; 4] {
    let mut v = key.map(|x| x.wrapping_mul(1_664_525).wrapping_add(1_013_904_223));
    let round = |v: &mut [u32; 4]| {
        for [to, a, b] in [[0, 1, 3], [1, 2, 0], [2, 0, 1], [3, 1, 2]] {
            v[to] = v[to].wrapping_add(v[a].wrapping_mul(v[b]));
        }
    };
    round(&mut v);
    v = v.map(|x| x ^ x >> 16);
    round(&mut v);
    v
}

fn unit(word: u32) -> f64 {
    f64::from(word >> 8) / f64::from(1 << 24)
}

fn octahedral(word: u32) -> DVec3 {
    let signed = |half: u32| f64::from(half as u16 as i16).max(-32767.0) / 32767.0;
    let (x, y) = (signed(word & 0xffff), signed(word >> 16));
    let z = 1.0 - x.abs() - y.abs();
    let fold = |a: f64, b: f64| (1.0 - b.abs()) * if a >= 0.0 { 1.0 } else { -1.0 };
    let (x, y) = if z < 0.0 { (fold(x, y), fold(y, x)) } else { (x, y) };
    DVec3::new(x, y, z).normalize()
}

impl<'a> Oracle<'a> {
    pub fn new(volume: &'a Volume, scene: &'a Scene, frame: &'a PhotonFrame) -> Self {
        Self { volume, scene, frame, spacing: volume.spacing(), extent: volume.extent() }
    }

    pub fn judge(&self, now: &Snapshot) -> Found {
        let mut found = Found::default();
        let mut slots = now.slots.chunks_exact(self.frame.map.max_events as usize);
        let lights = self.frame.scene.lights;
        for light in &lights.all[..lights.count as usize] {
            for photon in 0..light.photons {
                let slots = slots.next().expect("a slot for each photon");
                self.judge_photon([light.stream, photon], slots, &mut found);
            }
        }
        for (i, segment) in now.segments.iter().enumerate() {
            let count = self.scene.settings.segments as usize;
            let (pixel, index) = ((i / count) as u32, (i % count) as u32);
            let mask = u64::from(segment[4]) | u64::from(segment[5]) << 32;
            if let Some(values) = self.of_segment(pixel, index) {
                found.judge(1, mask, &values);
            }
        }
        found
    }

    /// Judges the histories of means around points: every tap's value.
    pub fn judge_means(&self, points: &[([u32; 4], u64)], radius: f64) -> Found {
        let mut found = Found::default();
        for (place, mask) in points {
            let [x, y, z, _] = place.map(|word| f64::from(f32::from_bits(word)));
            let centre = DVec3::new(x, y, z);
            let shell = |radius: f64, from: u32| {
                (0..16).map(move |i| {
                    let z = 1.0 - (2.0 * f64::from(i) + 1.0) / 16.0;
                    let (y, x) = (2.399_963 * f64::from(from + i)).sin_cos();
                    radius * DVec3::new(x, y, 0.0) * (1.0 - z * z).sqrt() + DVec3::Z * radius * z
                })
            };
            let taps = shell(0.63 * radius, 0).chain(shell(0.9086 * radius, 16));
            let taps = [DVec3::ZERO].into_iter().chain(taps).map(|by| centre + by);
            let within =
                |p: &DVec3| p.min_element() > CLOSE && (self.extent - *p).min_element() > CLOSE;
            // A device's sines are not exact.
            let near = |e: u32| [e.saturating_sub(8), e, (e + 8).min(ENTRIES as u32 - 1)];
            let bins = |entries: Vec<u32>| {
                entries.into_iter().flat_map(near).fold(0, |m, e| m | 1 << self.bin(e))
            };
            let values = taps.filter(within).filter_map(|tap| self.entries_at(tap).map(bins));
            found.judge(0, *mask, &values.collect::<Vec<_>>());
        }
        found
    }

    fn judge_photon(&self, id: [u32; 2], slots: &[[[u32; 4]; 2]], found: &mut Found) {
        let place = |slot: &[[u32; 4]; 2]| {
            let [x, y, z, _] = slot[0];
            DVec3::new(f32::from_bits(x).into(), f32::from_bits(y).into(), f32::from_bits(z).into())
        };
        for (event, slot) in slots.iter().enumerate().take_while(|(_, s)| s[1][1] >> 30 != 0) {
            let mut values = Vec::new();
            let (end, direction) = (place(slot), octahedral(slot[0][3]));
            // A photon of these lights comes from outside: it enters where its line does.
            let length = match event {
                0 => self.back_to_the_bounds(end, direction),
                _ => end.distance(place(&slots[event - 1])),
            };
            let start = end - direction * length;
            self.of_flight(id, event as u32, (start, direction, length), &mut values);
            let mask = u64::from(slot[1][2]) | u64::from(slot[1][3]) << 32;
            found.judge(0, mask, &values);
        }
    }

    fn back_to_the_bounds(&self, from: DVec3, direction: DVec3) -> f64 {
        let far = (0..3).map(|a| match direction[a] {
            d if d > 0.0 => from[a] / d,
            d if d < 0.0 => (from[a] - self.extent[a]) / d,
            _ => f64::INFINITY,
        });
        far.fold(f64::INFINITY, f64::min)
    }

    /// Ray parameters in (`begin`, `end`) where a line crosses planes of multiples of `edge`,
    /// with both ends.
    fn crossings(
        &self,
        (start, direction): (DVec3, DVec3),
        edge: DVec3,
        begin: f64,
        end: f64,
    ) -> Vec<f64> {
        let mut all = vec![begin, end];
        for axis in 0..3 {
            let planes = (self.extent[axis] / edge[axis]).ceil() as i32;
            let at =
                (0..=planes).map(|i| (f64::from(i) * edge[axis] - start[axis]) / direction[axis]);
            all.extend(at.filter(|t| (begin..end).contains(t)));
        }
        all.sort_by(f64::total_cmp);
        all
    }

    /// All tentative collisions before a flight's end: each could have become real.
    fn of_flight(
        &self,
        [stream, index]: [u32; 2],
        event: u32,
        (start, direction, length): (DVec3, DVec3, f64),
        values: &mut Vec<u64>,
    ) {
        let [k0, k1, ..] = pcg4d([stream, index, event, FOR_FLIGHT]);
        let majorant = f64::from(self.frame.scene.params.majorant);
        let edge = self.spacing * MACRO_CELL;
        let cells = (self.extent / edge - 1e-6).ceil().as_uvec3();
        let t = self.crossings((start, direction), edge, 0.0, length);
        for pair in t.windows(2) {
            let [enter, leave] = [pair[0], pair[1]];
            if leave - enter < CLOSE {
                continue;
            }
            let middle = (start + direction * (enter + leave) / 2.0) / edge;
            let cell = middle.floor().max(DVec3::ZERO).as_uvec3().min(cells - UVec3::ONE);
            let cell = (cell.z * cells.y + cell.y) * cells.x + cell.x;
            for layer in 0..LAYERS {
                let width = 0.5_f64.powi((layer + 1).min(LAYERS - 1) as i32);
                let mut at = enter;
                for j in 0.. {
                    let words = pcg4d([k0, k1, cell * LAYERS + layer, j]);
                    at -= (1.0 - unit(words[0])).ln() / (majorant * width);
                    if at > leave - CLOSE || at > length - CLOSE {
                        break;
                    }
                    if let Some(entries) = self.entries_at(start + direction * at) {
                        values.push(entries.iter().fold(0, |m, &e| m | self.mark_bit(e, layer)));
                    }
                }
            }
        }
    }

    fn bin(&self, entry: u32) -> u32 {
        self.frame.scene.bins.bin(entry as usize)
    }

    /// The bit of a value and a mark: as many neighbouring bins as there are classes of marks
    /// share theirs.
    fn mark_bit(&self, entry: u32, layer: u32) -> u64 {
        let classes = self.frame.scene.params.mark_classes;
        1 << (self.bin(entry) / classes * classes + layer * classes / LAYERS)
    }

    /// The table entries that a point's value may be taken for; `None` where its voxel is not
    /// certain.
    fn entries_at(&self, point: DVec3) -> Option<Vec<u32>> {
        let at = point / self.spacing;
        let size = UVec3::from(self.volume.size()).as_ivec3();
        let voxel = |i: glam::IVec3| {
            let i = i.clamp(glam::IVec3::ZERO, size - 1).as_uvec3();
            f64::from(self.volume.number(i.x, i.y, i.z))
        };
        let value = match self.scene.filter {
            Filter::Nearest => {
                let close = (at - at.round()).abs() * self.spacing;
                if close.min_element() < CLOSE {
                    return None;
                }
                voxel(at.floor().as_ivec3())
            }
            Filter::Linear => {
                let base = (at - 0.5).floor();
                let f = at - 0.5 - base;
                let corner = |c: u32| {
                    let c = glam::IVec3::new((c & 1) as i32, (c >> 1 & 1) as i32, (c >> 2) as i32);
                    let w = c.as_dvec3() * f + (1.0 - c.as_dvec3()) * (1.0 - f);
                    w.x * w.y * w.z * voxel(base.as_ivec3() + c)
                };
                (0..8).map(corner).sum()
            }
        };
        let slack = if self.scene.filter == Filter::Nearest { 0.01 } else { 0.5 };
        let around = [-slack, 0.0, slack];
        let params = &self.frame.scene.params;
        let at = value * f64::from(params.gain) + f64::from(params.shift);
        let entry = |by: f64| (at + by).clamp(0.0, ENTRIES - 1.0) as u32;
        let mut entries = around.map(entry).to_vec();
        entries.dedup();
        Some(entries)
    }

    /// The values that a segment must have relied on, or `None` where their number is
    /// not certain.
    fn of_segment(&self, pixel: u32, index: u32) -> Option<Vec<u64>> {
        let camera = &self.scene.camera;
        let view = camera.view().expect("the scene is settled");
        let x = f64::from(pixel % camera.width) + 0.5;
        let y = f64::from(pixel / camera.width) + 0.5;
        let local = self.volume.local_from_world();
        let across = 2.0 * x / f64::from(camera.width) - 1.0;
        let down = 2.0 * y / f64::from(camera.height) - 1.0;
        let way = view.forward + across * view.right + down * view.down;
        let (origin, way) =
            (local.transform_point3(view.origin), local.transform_vector3(way).normalize());
        let (near, far) = (-origin / way, (self.extent - origin) / way);
        let enter = near.min(far).max_element().max(0.0);
        let leave = near.max(far).min_element();
        let length = leave - enter;
        if length < CLOSE {
            return None;
        }
        let segments = f64::from(self.scene.settings.segments);
        let mut values = Vec::new();
        let mut depth = 0.0;
        let any = |entries: &[u32]| entries.iter().fold(0, |m, &e| m | 1 << self.bin(e));
        let extinction = |e: u32| f64::from(self.frame.scene.table.extinction[e as usize]);
        let entries_at = |t: f64| self.entries_at(origin + way * t);
        // A segment that is opaque is not looked into any further.
        let is_opaque = |depth: f64| depth > 22.0;
        match self.scene.filter {
            Filter::Linear => {
                let samples = length / f64::from(self.frame.scene.params.step);
                if (samples - samples.round()).abs() < 0.01 {
                    return None;
                }
                let samples = samples.ceil() as u32;
                let step = length / f64::from(samples);
                let bound = |index: u32| samples * index / self.scene.settings.segments;
                for i in bound(index)..bound(index + 1) {
                    if is_opaque(depth) {
                        break;
                    }
                    let end = |i: u32| entries_at(enter + f64::from(i) * step);
                    let (Some(a), Some(b)) = (end(i), end(i + 1)) else { continue };
                    values.extend([any(&a), any(&b)]);
                    // Between two values are all that lie between.
                    let least = |entries: &[u32]| entries.iter().copied().fold(u32::MAX, u32::min);
                    let most = |entries: &[u32]| entries.iter().copied().fold(0, u32::max);
                    let certain = most(&a).min(most(&b))..=least(&a).max(least(&b));
                    values.extend(certain.map(|e| any(&[e])));
                    let possible = least(&a).min(least(&b))..=most(&a).max(most(&b));
                    depth += possible.map(extinction).fold(0.0, f64::max) * step;
                }
            }
            Filter::Nearest => {
                let begin = enter + length * f64::from(index) / segments;
                let end = enter + length * f64::from(index + 1) / segments;
                let t = self.crossings((origin, way), self.spacing, begin, end);
                for pair in t.windows(2).filter(|pair| pair[1] - pair[0] > 3.0 * CLOSE) {
                    if is_opaque(depth) {
                        break;
                    }
                    if let Some(entries) = entries_at((pair[0] + pair[1]) / 2.0) {
                        values.push(any(&entries));
                        let greatest = entries.into_iter().map(extinction).fold(0.0, f64::max);
                        depth += greatest * (pair[1] - pair[0]);
                    }
                }
            }
        }
        Some(values)
    }
}
