//! When the target's surface is told: at fixed places of the ledger, the first epoch of a second of the session.

use tumbled_model::{RigNs, UnixNs};

use super::contour::ContourMaker;
use super::engine::Step;
use crate::stream::{ContourLine, ModelView, StreamOrigin};

const SECOND_NS: i64 = 1_000_000_000;
/// A model that does not change is told so often all the same, s: to who came meanwhile.
const AGAIN_S: i64 = 5;

/// What was told of the surface so far.
#[derive(Debug)]
pub struct SurfaceTold {
    contour: Option<ContourMaker>,
    newest: Option<ContourLine>,
    /// The second that was looked at last.
    second: i64,
    /// The second in which the model was told last, and what it was: the target, its frames and its pieces.
    told: Option<(i64, Mark)>,
}

type Mark = (u32, usize, usize);

/// What is to be told.
#[derive(Debug)]
pub struct Due<'a> {
    /// The model.
    pub model: ModelView<'a>,
    /// The newest contour of the same target, if there is one.
    pub contour: Option<ContourLine>,
}

impl SurfaceTold {
    /// Nothing yet. Without a thread there is no contour, which is told.
    pub fn new(origin: StreamOrigin) -> Self {
        let contour = ContourMaker::start(origin)
            .inspect_err(|error| tracing::warn!("the contour is not shown: there is no thread for it: {error}"))
            .ok();
        Self { contour, newest: None, second: i64::MIN, told: None }
    }

    /// What is due after a step's newest epoch, with wall time `unix`; asked only where somebody wants it.
    pub fn due<'a>(&mut self, step: &'a Step<'_>, (epoch, t, unix): (u64, RigNs, UnixNs)) -> Option<Due<'a>> {
        let second = t.0.div_euclid(SECOND_NS);
        if second == self.second {
            return None;
        }
        self.second = second;
        let (target, tracker) = step.model()?;
        let mark = (target, tracker.insertions(), tracker.surfels().len());
        if !is_due(self.told, second, mark) {
            return None;
        }
        self.told = Some((second, mark));
        let model = ModelView::new((target, tracker), epoch, (t, unix));
        if let Some(maker) = &self.contour {
            self.newest = maker.take().or(self.newest.take()).filter(|line| line.target == target);
            maker.offer(&model);
        }
        Some(Due { model, contour: self.newest.clone() })
    }
}

/// Whether a model is to be told in a second: another one than was told, or nothing was told for a while.
fn is_due(told: Option<(i64, Mark)>, second: i64, mark: Mark) -> bool {
    // A replay that begins anew goes back in time.
    told.is_none_or(|(at, before)| before != mark || !(at..at + AGAIN_S).contains(&second))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_model_that_changed_is_due_and_one_that_did_not_every_fifth_second() {
        let mark = (1, 10, 2_000);
        assert!(is_due(None, 3, mark));
        for changed in [(2, 10, 2_000), (1, 11, 2_000), (1, 10, 2_001)] {
            assert!(is_due(Some((3, mark)), 4, changed));
        }
        assert_eq!((4..=8).filter(|second| is_due(Some((3, mark)), *second, mark)).collect::<Vec<_>>(), [8]);
        assert!(is_due(Some((3, mark)), 0, mark), "time went back");
    }
}
