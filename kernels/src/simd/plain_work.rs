//! Plain code compiled for the processor at hand: population counts and shifts that the oldest processors lack.

use super::{Kernel, Level, Simd};

/// Runs `work` compiled for the best registers of this processor, as far as the compiler inlines it.
#[inline]
pub fn at_best<R>(work: impl FnOnce() -> R) -> R {
    Level::best().run(Work(work))
}

struct Work<F>(F);

impl<F: FnOnce() -> R, R> Kernel for Work<F> {
    type Output = R;

    #[inline(always)]
    fn run<S: Simd>(self, _: S) -> R {
        (self.0)()
    }
}
