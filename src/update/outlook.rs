//! How far an update is, and what it expects to take: as long as the one before of its kind.

use std::time::{Duration, Instant};

/// How far an update is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Outlook {
    /// The share that is done, from 0 to 1.
    pub done: f64,
    /// How long the rest will take, if an update of its kind was made before.
    pub rest: Option<Duration>,
}

/// Stages of an update: photons, light field, segments.
const STAGES: usize = 3;

/// What the stages of an update took.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Took([Duration; STAGES]);

impl Took {
    fn all(&self) -> Duration {
        self.0.iter().sum()
    }
}

/// When an update began, and its stages ended.
#[derive(Clone, Copy, Debug)]
pub(super) struct Watch {
    stage: usize,
    begun: Instant,
    took: Took,
}

impl Watch {
    /// An update begins.
    pub fn begin() -> Self {
        Self { stage: 0, begun: Instant::now(), took: Took::default() }
    }

    /// A stage has ended.
    pub fn end_stage(&mut self) {
        if self.stage < STAGES {
            self.took.0[self.stage] += self.begun.elapsed();
            self.stage += 1;
        }
        self.begun = Instant::now();
    }

    /// What its stages took.
    pub fn took(&self) -> Took {
        self.took
    }

    /// How far it is, when this share of its stage is done, if the one before `took` so long.
    pub fn outlook(&self, share: f64, before: Option<&Took>) -> Outlook {
        // Where nothing is known, one stage is as long as another.
        let even = Took([Duration::from_secs(1); STAGES]);
        let known = before.filter(|took| took.all() > Duration::ZERO);
        let expected = known.unwrap_or(&even);
        let ended: Duration = expected.0[..self.stage].iter().sum();
        let now = expected.0.get(self.stage).copied().unwrap_or_default();
        let all = expected.all().as_secs_f64();
        let done = ((ended + now.mul_f64(share)).as_secs_f64() / all).clamp(0.0, 1.0);
        Outlook { done, rest: known.map(|took| took.all().mul_f64(1.0 - done)) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_outlook_is_by_what_the_update_before_took() {
        let before = Took([1, 2, 5].map(Duration::from_secs));
        let mut watch = Watch::begin();
        let at = |watch: &Watch, share| watch.outlook(share, Some(&before));
        assert_eq!(at(&watch, 0.0).rest, Some(Duration::from_secs(8)));
        assert_eq!(at(&watch, 0.5).done, 0.5 / 8.0);
        watch.end_stage();
        assert_eq!(at(&watch, 0.5).rest, Some(Duration::from_secs(6)));
        watch.end_stage();
        watch.end_stage();
        assert_eq!(at(&watch, 0.0), Outlook { done: 1.0, rest: Some(Duration::ZERO) });
        assert_eq!(watch.outlook(0.0, None), Outlook { done: 1.0, rest: None });
        assert_eq!(Watch::begin().outlook(0.5, None), Outlook { done: 0.5 / 3.0, rest: None });
    }
}
