//! The project's own control laws.

use ::cycles::{Input, Law};

use super::subject::Subject;

/// One of them, in float or fixed point.
pub struct Control<L>(L);

impl<L: Law> Subject for Control<L> {
    type Input = Input;
    type Output = u32;

    fn new() -> Self {
        Self(L::new())
    }

    #[inline(always)]
    fn update(&mut self, input: &Input) -> u32 {
        self.0.update(input)
    }
}
