//! Tables of jumps: a `match` becomes a jump by an entry of a table that stands among the code.
//!
//! How many entries a table has is often not to be seen: the compiler knows the values of an enum.
//! So a table is followed entry by entry, when every other path has been. It ends where something
//! else begins: code, a literal or a table that was reached. It also ends with an entry that leads
//! out of its function or into data. An entry too many, as the byte that fills up a table, is
//! possible; it can only add a path.

use std::collections::{BTreeMap, BTreeSet};

use super::super::program::Program;
use super::super::value::{State, Table};

/// The function and the instruction that jumps.
pub type Place = (u32, u32);

struct Jump {
    table: Table,
    /// What entries are added to; those of addresses, to nothing.
    from: Option<u32>,
    state: State,
    targets: Vec<u32>,
    is_closed: bool,
}

/// The tables that were reached, and what is known to be something else.
#[derive(Default)]
pub struct Tables {
    jumps: BTreeMap<Place, Jump>,
    /// Half-words of instructions that were reached.
    pub code: BTreeSet<u32>,
    /// Half-words of literals and of tables' entries.
    pub data: BTreeSet<u32>,
}

impl Tables {
    /// A jump by a table was reached; `from` is what its entries are added to. The entries that
    /// are to be followed anew, because less is known there than before.
    pub fn note(
        &mut self,
        place: Place,
        table: Table,
        from: Option<u32>,
        state: &State,
    ) -> Vec<u32> {
        let jump = self.jumps.entry(place).or_insert_with(|| Jump {
            table,
            from,
            state: state.clone(),
            targets: Vec::new(),
            is_closed: false,
        });
        let joined = jump.state.join(state);
        if joined == jump.state {
            return Vec::new();
        }
        jump.state = joined;
        jump.targets.clone()
    }

    /// What is known at a jump.
    pub fn state(&self, place: Place) -> State {
        (self.jumps.get(&place)).map_or_else(State::at_entry, |jump| jump.state.clone())
    }

    /// The next entry of each table, and the jump that goes there; none when all are followed.
    pub fn open(&mut self, program: &Program) -> Vec<(Place, u32)> {
        let Self { jumps, code, data } = self;
        let mut found = Vec::new();
        for (place, jump) in jumps.iter_mut().filter(|(_, jump)| !jump.is_closed) {
            match jump.next(*place, code, data, program) {
                Some(target) => {
                    jump.targets.push(target);
                    found.push((*place, target));
                }
                None => jump.is_closed = true,
            }
        }
        for (place, _) in &found {
            if let Some(jump) = jumps.get(place) {
                let end = jump.table.address + jump.table.width * jump.targets.len() as u32;
                data.extend((jump.table.address & !1..end).step_by(2));
            }
        }
        found
    }

    /// Jumps whose table has no entry.
    pub fn empty(&self) -> impl Iterator<Item = u32> {
        let empty = self.jumps.iter().filter(|(_, jump)| jump.targets.is_empty());
        empty.map(|((_, at), _)| *at)
    }
}

impl Jump {
    /// Where the next entry leads, if it is one.
    fn next(
        &self,
        place: Place,
        code: &BTreeSet<u32>,
        data: &BTreeSet<u32>,
        program: &Program,
    ) -> Option<u32> {
        let Table { address, width, shift } = self.table;
        let at = address + width * self.targets.len() as u32;
        let halves = (at & !1..at + width).step_by(2);
        let is_own = |half: u32| half < at && half >= address & !1 && at > address;
        let mut halves = halves.filter(|half| !is_own(*half));
        if halves.any(|half| code.contains(&half) || data.contains(&half)) {
            return None;
        }
        let entry = match width {
            1 => program.byte(at)?.into(),
            2 => program.half(at)?.into(),
            _ => program.word(at)?,
        };
        let target = match self.from {
            Some(from) => from.checked_add(entry << shift)?,
            // An address of code has bit 0 set.
            None => entry.checked_sub(1)?,
        };
        let is_target = target.is_multiple_of(2)
            && !(address & !1..at + width).contains(&target)
            && program.contains(target)
            && !program.is_data(target)
            && program.function(target)?.start == program.function(place.0)?.start;
        is_target.then_some(target)
    }
}
