//! How deep each function can take the stack: its own part of it at a call and what the called
//! function takes, the deepest of all calls.
//!
//! A function that can come to itself again has no bound by its code alone. One that is known to be
//! on the stack a limited number of times at once is [`Bounded`]: every cycle of calls must lead
//! through one of them.

use std::cell::RefCell;
use std::collections::{BTreeMap, BTreeSet};

use super::program::{Pointers, Program};
use super::walk::{Call, Frame, Problem, Target};

/// A function that can be on the stack more than once at a time, but not more often than this.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Bounded {
    /// Its name, demangled.
    pub function: String,
    /// How often.
    pub times: u8,
    /// Why.
    pub why: String,
}

/// A function on the way to the deepest point, and the bytes that it has on the stack there.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Step {
    /// The function.
    pub function: u32,
    /// Its own bytes.
    pub bytes: u32,
}

/// The stack from one function down: its deepest way.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Deepest {
    /// Bytes.
    pub bytes: u32,
    /// From the function itself to the last one.
    pub path: Vec<Step>,
}

/// How often each bounded function may still be entered.
type Budget = Vec<u8>;

/// The deepest way of a function: bytes, its own of them, and whom it calls for that.
type Way = (u32, u32, Option<u32>);

/// All calls of an image.
pub struct Calls {
    /// The functions that are reached, by address.
    pub frames: BTreeMap<u32, Frame>,
    pointers: Pointers,
    bounded: Vec<(u32, u8)>,
    known: RefCell<BTreeMap<(u32, Budget), Way>>,
}

impl Calls {
    /// Of functions and the functions that pointers may lead to.
    pub fn new(
        program: &Program,
        frames: BTreeMap<u32, Frame>,
        pointers: Pointers,
        bounded: &[Bounded],
    ) -> Self {
        let bound = |function: &u32| {
            let name = program.name(*function);
            let found = bounded.iter().find(|one| one.function == name)?;
            Some((*function, found.times))
        };
        let bounded = frames.keys().filter_map(bound).collect();
        Self { frames, pointers, bounded, known: RefCell::default() }
    }

    /// Whom a call may reach.
    pub fn reached_by(&self, call: &Call) -> BTreeSet<u32> {
        let all = call.targets.iter().flat_map(|target| match target {
            Target::Function(function) => BTreeSet::from([*function]),
            Target::Pointer(from) => self.pointers.candidates(*from),
        });
        all.collect()
    }

    /// Whether a bound stands for this function.
    pub fn is_bounded(&self, function: u32) -> bool {
        self.bounded.iter().any(|(bounded, _)| *bounded == function)
    }

    /// The cycles of calls that lead through no bounded function, each as the functions on it.
    pub fn recursions(&self, program: &Program) -> Vec<Problem> {
        let mut done = BTreeSet::new();
        let mut found = Vec::new();
        for &function in self.frames.keys() {
            self.search(function, &mut Vec::new(), &mut done, &mut found);
        }
        let named = found.into_iter().map(|cycle| {
            let names: Vec<_> = cycle.iter().map(|at| program.name(*at)).collect();
            Problem {
                at: cycle[0],
                what: format!("recursion without a bound: {}", names.join(" calls ")),
            }
        });
        named.collect()
    }

    fn search(
        &self,
        function: u32,
        path: &mut Vec<u32>,
        done: &mut BTreeSet<u32>,
        found: &mut Vec<Vec<u32>>,
    ) {
        if self.is_bounded(function) {
            return;
        }
        if let Some(begin) = path.iter().position(|one| *one == function) {
            let cycle = path[begin..].iter().chain([&function]);
            found.push(cycle.copied().collect());
            return;
        }
        if !done.insert(function) {
            return;
        }
        path.push(function);
        let calls = self.frames.get(&function).map(|frame| frame.calls.values());
        for call in calls.into_iter().flatten() {
            for target in self.reached_by(call) {
                self.search(target, path, done, found);
            }
        }
        path.pop();
    }

    /// The deepest way from a function. There must be no [`recursions`](Self::recursions).
    pub fn deepest(&self, function: u32) -> Deepest {
        let mut budget: Budget = self.bounded.iter().map(|(_, times)| *times).collect();
        let mut at = Some(function);
        let mut deepest = Deepest::default();
        while let Some(function) = at
            && let Some((_, bytes, next)) = self.bytes(function, &budget)
        {
            deepest.bytes += bytes;
            deepest.path.push(Step { function, bytes });
            budget = self.entered(function, &budget).unwrap_or_default();
            at = next;
        }
        deepest
    }

    /// What is left of the budget in a function; `None` if it cannot be entered any more.
    fn entered(&self, function: u32, budget: &Budget) -> Option<Budget> {
        let mut left = budget.clone();
        if let Some(place) = self.bounded.iter().position(|(bounded, _)| *bounded == function) {
            left[place] = left[place].checked_sub(1)?;
        }
        Some(left)
    }

    fn bytes(&self, function: u32, budget: &Budget) -> Option<Way> {
        let left = self.entered(function, budget)?;
        let key = (function, budget.clone());
        if let Some(known) = self.known.borrow().get(&key) {
            return Some(*known);
        }
        let frame = self.frames.get(&function)?;
        let mut deepest = (frame.own, frame.own, None);
        for call in frame.calls.values() {
            for target in self.reached_by(call) {
                if let Some((bytes, ..)) = self.bytes(target, &left)
                    && call.depth + bytes > deepest.0
                {
                    deepest = (call.depth + bytes, call.depth, Some(target));
                }
            }
        }
        self.known.borrow_mut().insert(key, deepest);
        Some(deepest)
    }
}
