//! Who hears how far long work is, and may have it abandoned.

/// Hears of the progress of long work, and may have an update abandoned.
#[derive(Default)]
pub struct Progress<'a> {
    hear: Option<&'a mut dyn FnMut(&'static str, u64, u64)>,
    stop: Option<&'a mut dyn FnMut(&'static str) -> bool>,
    /// Which part of a stage is done now, of how many.
    part: Option<[u64; 2]>,
}

impl<'a> Progress<'a> {
    /// Tells `hear` the stage, the items done, and the items in all.
    pub fn new(hear: &'a mut dyn FnMut(&'static str, u64, u64)) -> Self {
        Self { hear: Some(hear), ..Self::default() }
    }

    /// Nobody hears.
    pub fn silent() -> Self {
        Self::default()
    }

    /// Asks `stop` at every boundary of an update (before each part of `photons`, in a rebuild each
    /// batch, before the `light field`, before the `segments`) whether to abandon it there.
    pub fn until(stop: &'a mut dyn FnMut(&'static str) -> bool) -> Self {
        Self { stop: Some(stop), ..Self::default() }
    }

    pub(crate) fn stops(&mut self, boundary: &'static str) -> bool {
        self.stop.as_mut().is_some_and(|stop| stop(boundary))
    }

    /// What comes next is this part of a stage, of so many alike.
    pub(crate) fn set_part(&mut self, part: u64, of: u64) {
        self.part = Some([part, of]);
    }

    pub(crate) fn at(&mut self, stage: &'static str, done: u64, total: u64) {
        if let Some(hear) = &mut self.hear {
            let [part, of] = self.part.unwrap_or([0, 1]);
            hear(stage, part * total + done, of * total);
        }
    }
}
