//! Input that is hard on what is measured, made out of plain input.

use rand::rngs::StdRng;
use rand::{Rng, SeedableRng};

/// What a sort of input is, in words, and inputs to be given one after the other.
pub type Sort<T> = (&'static str, Vec<T>);

/// Inputs of each of the `sorts`, then some of all by turns; `numbers` says how many. `change`
/// makes a hard input of a `plain` one, of which there must be at least one.
pub fn sorts<T: Copy, C: Copy>(
    plain: &[T],
    sorts: &[(&'static str, C)],
    numbers: [usize; 2],
    change: impl Fn(C, &mut T, &mut StdRng),
) -> Vec<Sort<T>> {
    let rng = &mut StdRng::seed_from_u64(1);
    let mut changed = |number: usize, choose: &dyn Fn(&mut StdRng) -> C| -> Vec<T> {
        let inputs = plain.iter().copied().cycle().take(number);
        let changed = inputs.map(|mut input| {
            change(choose(rng), &mut input, rng);
            input
        });
        changed.collect()
    };
    let [of_each, mixed] = numbers;
    let each = sorts.iter().map(|&(name, sort)| (name, changed(of_each, &|_| sort)));
    let mut all: Vec<Sort<T>> = each.collect();
    let any = |rng: &mut StdRng| sorts[rng.random_range(0..sorts.len())].1;
    all.push(("all sorts by turns", changed(mixed, &any)));
    all
}
