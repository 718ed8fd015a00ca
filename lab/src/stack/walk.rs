//! From functions to their calls: follows every path of every function that is reached.
//!
//! Only what can be reached is decoded, so that literals and tables among the code are not taken
//! for code. Behind a call the path goes on once the called function is known to return: behind
//! one that never does, there may be data.
//!
//! | what | how it is followed |
//! |---|---|
//! | BL to a function | a call |
//! | BL into the same function | a jump: B does not reach far in a large function |
//! | B to another function, also on a condition | a tail call |
//! | BLX, BX by a known address | a call, a tail call |
//! | BLX, BX by another value | an indirect call to every candidate ([`Pointers`]) |
//! | BX LR, POP to PC with the return address | a return; the stack must be as it was |
//! | `mov pc`, `add pc` by an entry of a table in flash | a jump to each entry (`table`) |
//! | UDF | the end |
//!
//! Anything else that would go on at an unknown place, or with an unknown stack pointer, is a
//! [`Problem`]: then the stack has no proven bound.

mod rare;
mod table;

use std::collections::{BTreeMap, BTreeSet};

use samd21::code::{Instruction, Operation};

use super::program::{Pointers, Program};
use super::value::{LR, Origin, State, Table, Value};
use table::{Place, Tables};

/// The least that a function has been seen to use, and whom it calls.
#[derive(Clone, Debug, Default)]
pub struct Frame {
    /// Its own stack at the deepest, bytes.
    pub own: u32,
    /// Its calls by the address of the instruction.
    pub calls: BTreeMap<u32, Call>,
    returns: bool,
    waiting: Vec<Waiting>,
}

/// A call, or a tail call.
#[derive(Clone, Debug, Default)]
pub struct Call {
    /// The function's own stack in use, bytes.
    pub depth: u32,
    /// Whom it may reach.
    pub targets: BTreeSet<Target>,
}

/// Whom a call reaches.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Target {
    /// This function.
    Function(u32),
    /// Any function that a pointer from there may lead to.
    Pointer(Origin),
}

impl Target {
    /// Whence the pointer comes, of a call by one.
    pub fn origin(&self) -> Option<Origin> {
        match self {
            Self::Function(_) => None,
            Self::Pointer(origin) => Some(*origin),
        }
    }
}

/// Why the stack has no proven bound.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Problem {
    /// Address of the instruction.
    pub at: u32,
    /// What it does, in words.
    pub what: String,
}

/// What goes on when a function is found to return.
#[derive(Clone, Debug)]
enum Waiting {
    /// The function that called it.
    Path(Box<Path>),
    /// The function that ended with it, by the jump at an address.
    Caller { function: u32, at: u32, would_return: bool },
}

/// A path that is to be followed.
#[derive(Clone, Debug)]
struct Path {
    function: u32,
    at: u32,
    state: State,
}

/// Where a path goes behind an instruction.
enum Next {
    /// To the instruction behind.
    Behind,
    /// Nowhere: what follows was put in the queue.
    Over,
}

/// What was found in a program.
#[derive(Clone, Debug, Default)]
pub struct Found {
    /// The functions that are reached, by address.
    pub frames: BTreeMap<u32, Frame>,
    /// Why there is no proven bound.
    pub problems: BTreeSet<Problem>,
    /// The half-words of the instructions that are reached.
    pub code: BTreeSet<u32>,
}

/// Follows `entries`, and all that they call, by `pointers` as well.
pub fn explore(
    program: &Program,
    entries: impl IntoIterator<Item = u32>,
    pointers: &Pointers,
) -> Found {
    let mut walk = Walk {
        program,
        frames: BTreeMap::new(),
        states: BTreeMap::new(),
        queue: Vec::new(),
        tables: Tables::default(),
        problems: BTreeSet::new(),
    };
    for entry in entries {
        walk.follow(entry);
    }
    // What is called by a pointer may call by others.
    let mut known = BTreeSet::new();
    loop {
        let origins = walk.origins();
        let new = origins.difference(&known).copied();
        let new: BTreeSet<u32> = new.flat_map(|from| pointers.candidates(from)).collect();
        if origins == known {
            break;
        }
        new.into_iter().for_each(|function| walk.follow(function));
        known = origins;
    }
    let empty = walk
        .tables
        .empty()
        .map(|at| Problem { at, what: "jumps by a table of which no entry is one".into() });
    walk.problems.extend(empty);
    Found { problems: walk.problems, code: walk.tables.code, frames: walk.frames }
}

/// The functions that have been reached, and what is known at the beginning of their paths.
struct Walk<'a> {
    program: &'a Program,
    frames: BTreeMap<u32, Frame>,
    states: BTreeMap<(u32, u32), State>,
    queue: Vec<Path>,
    tables: Tables,
    problems: BTreeSet<Problem>,
}

impl Walk<'_> {
    /// Follows a function and all that it calls by a known address.
    fn follow(&mut self, function: u32) {
        self.reach(function);
        loop {
            while let Some(path) = self.queue.pop() {
                self.run(path);
            }
            let found = self.tables.open(self.program);
            if found.is_empty() {
                break;
            }
            for (place, target) in found {
                self.go(place.0, target, &self.tables.state(place));
            }
        }
    }

    /// Whence the pointers come by which functions are called.
    fn origins(&self) -> BTreeSet<Origin> {
        let calls = self.frames.values().flat_map(|frame| frame.calls.values());
        calls.flat_map(|call| &call.targets).filter_map(Target::origin).collect()
    }

    fn reach(&mut self, function: u32) {
        if let std::collections::btree_map::Entry::Vacant(vacant) = self.frames.entry(function) {
            vacant.insert(Frame::default());
            self.go(function, function, &State::at_entry());
        }
    }

    fn frame(&mut self, function: u32) -> &mut Frame {
        self.frames.entry(function).or_default()
    }

    fn problem(&mut self, at: u32, what: &str) {
        self.problems.insert(Problem { at, what: what.into() });
    }

    /// Goes on at an address of the same function, unless all that is new there is known.
    fn go(&mut self, function: u32, at: u32, state: &State) {
        let known = self.states.get(&(function, at));
        let joined = known.map_or_else(|| state.clone(), |known| known.join(state));
        if joined.depth().is_none() {
            return self.problem(at, "is reached with stack pointers that differ");
        }
        if known != Some(&joined) {
            self.states.insert((function, at), joined.clone());
            let state = joined;
            self.queue.push(Path { function, at, state });
        }
    }

    /// Follows a path until it branches or meets another one.
    fn run(&mut self, path: Path) {
        let Path { function, mut at, mut state } = path;
        loop {
            let Some(op) = self.program.half(at).filter(|_| !self.program.is_data(at)) else {
                return self.problem(at, "is reached and is no code");
            };
            let second = self.program.half(at + 2).unwrap_or(0);
            let instruction = Instruction::decode(at, op, second);
            let length = if op >> 11 > 0b11100 { 4 } else { 2 };
            self.tables.code.extend((at..at + length).step_by(2));
            if instruction.operation == Operation::LdrLiteral {
                self.tables.data.extend([instruction.imm, instruction.imm + 2]);
            }
            let next = self.take(function, at, length, op, &instruction, &mut state);
            let Some(depth) = state.depth() else {
                return self.problem(at, "sets the stack pointer to what is not known");
            };
            let frame = self.frame(function);
            frame.own = frame.own.max(depth.unsigned_abs());
            if depth < 0 {
                return self.problem(at, "gives back more stack than it took");
            }
            if let Next::Over = next {
                return;
            }
            at += length;
            if self.states.contains_key(&(function, at)) {
                return self.go(function, at, &state);
            }
        }
    }

    fn take(
        &mut self,
        function: u32,
        at: u32,
        length: u32,
        op: u16,
        instruction: &Instruction,
        state: &mut State,
    ) -> Next {
        use Operation::{Bl, Blx, Branch, Bx, Other, PopPc};
        let place = (function, at);
        match instruction.operation {
            operation if (Operation::Beq..=Operation::Ble).contains(&operation) => {
                self.jump(place, instruction.imm, state);
                self.go(function, at + length, state);
            }
            Branch => self.jump(place, instruction.imm, state),
            Bl => {
                let target = instruction.imm;
                let is_inside = self.is_inside(function, target) && target != function;
                if is_inside && !self.program.is_entry(target) {
                    state.set(LR as u8, Value::Unknown);
                    self.jump(place, target, state);
                } else {
                    self.call(place, at + length, target, state);
                }
            }
            Blx => match state.register(instruction.b) {
                Value::Number(target) => self.call(place, at + length, target & !1, state),
                value => {
                    self.note_call(place, pointer(value), state);
                    state.called();
                    self.go(function, at + length, state);
                }
            },
            Bx => self.leave(place, state.register(instruction.b), state),
            PopPc => {
                let pop = Instruction { operation: Operation::Pop, ..*instruction };
                state.step(&pop, self.program);
                match state.pop() {
                    target @ (Value::AtEntry(14) | Value::Number(_)) => {
                        self.leave(place, target, state);
                    }
                    _ => self.problem(at, "pops an address that is not the one to return to"),
                }
            }
            Other => return self.other(place, length, op, state),
            _ => {
                state.step(instruction, self.program);
                return Next::Behind;
            }
        }
        Next::Over
    }

    /// A jump by an entry of a table.
    fn jump_by(&mut self, place: Place, table: Table, from: Option<u32>, state: &State) {
        for target in self.tables.note(place, table, from, state) {
            self.go(place.0, target, &self.tables.state(place));
        }
    }

    fn lost(&mut self, at: u32) {
        self.problem(at, "jumps to what is not known");
    }

    /// Whether an address is one of a function.
    fn is_inside(&self, function: u32, address: u32) -> bool {
        let start = |address| Some(self.program.function(address)?.start);
        start(address) == Some(function)
    }

    /// A jump to a known address: within the function, or a tail call.
    fn jump(&mut self, place: Place, target: u32, state: &State) {
        let (function, at) = place;
        if target == function || !self.program.is_entry(target) {
            return self.go(function, target, state);
        }
        let would_return = state.would_return();
        self.enter(place, target, state, Waiting::Caller { function, at, would_return });
    }

    /// A call of a known function, after which the path goes on at `behind`.
    fn call(&mut self, place: Place, behind: u32, target: u32, state: &State) {
        let mut after = state.clone();
        after.called();
        let path = Path { function: place.0, at: behind, state: after };
        self.enter(place, target, state, Waiting::Path(Box::new(path)));
    }

    /// Goes to another function; what is `waiting` goes on if that one returns.
    fn enter(&mut self, place: Place, target: u32, state: &State, waiting: Waiting) {
        self.note_call(place, Target::Function(target), state);
        self.reach(target);
        let frame = self.frame(target);
        if frame.returns {
            self.resume(waiting);
        } else {
            frame.waiting.push(waiting);
        }
    }

    /// BX and what is like it: a return, or a tail call.
    fn leave(&mut self, place: Place, to: Value, state: &State) {
        let (function, at) = place;
        match to {
            Value::AtEntry(14) if state.is_unwound() => self.returns(function),
            Value::AtEntry(14) => self.problem(at, "returns with its stack in use"),
            Value::Number(target) => self.jump(place, target & !1, state),
            value => {
                self.note_call(place, pointer(value), state);
                if state.would_return() {
                    self.returns(function);
                } else {
                    self.problem(at, "jumps by a pointer, and whence that returns is not known");
                }
            }
        }
    }

    fn note_call(&mut self, place: Place, target: Target, state: &State) {
        let depth = state.depth().unwrap_or(0).unsigned_abs();
        let calls = &mut self.frame(place.0).calls;
        let call = calls.entry(place.1).or_default();
        call.depth = call.depth.max(depth);
        call.targets.insert(target);
    }

    fn returns(&mut self, function: u32) {
        let frame = self.frame(function);
        frame.returns = true;
        for waiting in std::mem::take(&mut frame.waiting) {
            self.resume(waiting);
        }
    }

    fn resume(&mut self, waiting: Waiting) {
        match waiting {
            Waiting::Path(path) => self.go(path.function, path.at, &path.state),
            Waiting::Caller { function, would_return: true, .. } => self.returns(function),
            Waiting::Caller { at, .. } => {
                self.problem(at, "ends with another function, its stack in use");
            }
        }
    }
}

/// Whom a call by such a value reaches.
fn pointer(value: Value) -> Target {
    Target::Pointer(match value {
        Value::Loaded(origin) => origin,
        _ => Origin::Unknown,
    })
}
