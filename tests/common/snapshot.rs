//! Everything that a frame holds, bit for bit.

use super::gpu;
use photogram::device_scene::DeviceScene;
use photogram::gpu::Gpu;
use photogram::gpu::Progress;
use photogram::gpu::counter::Counters;
use photogram::scene::Scene;
use photogram::segment::Segment;
use photogram::split::Split;
use photogram::update::PhotonFrame;
use photogram::volume::Volume;

/// Everything that a rebuild leaves on the device, in an order of its own.
#[derive(Clone)]
pub struct Snapshot {
    /// (place, state) of event k of photon p, photon by photon.
    pub slots: Vec<[[u32; 4]; 2]>,
    /// The light field's words: cells in their order, or all points, sorted.
    pub field: Vec<[u32; 8]>,
    pub segments: Vec<Segment>,
    pub pixels: Vec<[u32; 3]>,
    pub counts: Counters,
}

pub fn rebuild(gpu: &Gpu, scene: &Scene, volume: &Volume, split: &Split) -> Snapshot {
    let device = DeviceScene::new(gpu, scene, volume).expect("uploads");
    let mut frame = PhotonFrame::new(gpu, scene, device, split).expect("fits");
    frame.rebuild(gpu, split, &mut Progress::silent()).expect("rebuilds");
    snapshot(gpu, &frame)
}

/// What differs between a frame and a rebuild of the scene from nothing, histories aside.
pub fn difference(frame: &PhotonFrame, scene: &Scene, volume: &Volume) -> Option<&'static str> {
    let now = snapshot(gpu(), frame).without_histories();
    let fresh = rebuild(gpu(), scene, volume, &Split::default()).without_histories();
    now.difference(&fresh)
}

/// What the frame holds now.
pub fn snapshot(gpu: &Gpu, frame: &PhotonFrame) -> Snapshot {
    let slots = frame.map.read(gpu).expect("reads");
    let field: Vec<[u32; 8]> = match (frame.field.points(), frame.field.fluence()) {
        (Some(points), _) => points.sorted(gpu).expect("reads"),
        (_, Some(fluence)) => {
            let [r, g, b] = fluence.read(gpu).expect("reads");
            let cell = |i: usize| bytemuck::cast([r[i], g[i], b[i], 0]);
            (0..r.len()).map(cell).collect()
        }
        _ => panic!("another light field"),
    };
    let segments = frame.segments.read(gpu).expect("reads");
    let image = frame.segments.image(gpu).expect("reads");
    Snapshot {
        slots,
        field,
        segments,
        pixels: image.rgb.iter().map(|p| p.map(f32::to_bits)).collect(),
        counts: frame.counts(gpu).expect("reads"),
    }
}

impl Snapshot {
    pub fn without_histories(mut self) -> Self {
        for [_, state] in &mut self.slots {
            (state[2], state[3]) = (0, 0);
        }
        for segment in &mut self.segments {
            (segment[4], segment[5]) = (0, 0);
        }
        self
    }

    /// Which part differs first, if any.
    pub fn difference(&self, other: &Self) -> Option<&'static str> {
        if self.slots != other.slots {
            Some("slots")
        } else if self.field != other.field {
            Some("light field")
        } else if self.segments != other.segments {
            Some("segments")
        } else {
            (self.pixels != other.pixels).then_some("pixels")
        }
    }
}
