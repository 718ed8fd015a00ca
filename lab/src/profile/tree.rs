//! Cycles as a tree: thread or interrupt, function, what was inlined into it.

use std::collections::BTreeMap;

use samd21::chip::Profile;

use super::symbols::Symbols;
use crate::functions::exception_name;

/// A box of the chart: all cycles of a function under what it was called or inlined from.
#[derive(Debug, Default, PartialEq, Eq)]
pub struct Node {
    /// Cycles with everything below.
    pub cycles: u64,
    /// What is below, by name.
    pub below: BTreeMap<String, Node>,
}

impl Node {
    /// The tree of a profile.
    pub fn new(profile: &Profile, symbols: &mut Symbols<'_>) -> Self {
        let mut root = Self::default();
        for (exception, address, cycles) in profile.iter() {
            root.add(
                cycles,
                &[&[exception_name(exception.into())], symbols.path(address)].concat(),
            );
        }
        root
    }

    /// Adds cycles to this and to all along the path.
    pub fn add(&mut self, cycles: u64, path: &[String]) {
        self.cycles += cycles;
        if let [first, rest @ ..] = path {
            self.below.entry(first.clone()).or_default().add(cycles, rest);
        }
    }

    /// Cycles of this alone.
    pub fn own(&self) -> u64 {
        self.cycles - self.below.values().map(|node| node.cycles).sum::<u64>()
    }

    /// What is below, most cycles first.
    pub fn sorted(&self) -> Vec<(&str, &Self)> {
        let mut all: Vec<_> = self.below.iter().map(|(name, node)| (name.as_str(), node)).collect();
        all.sort_by(|a, b| b.1.cycles.cmp(&a.1.cycles).then(a.0.cmp(b.0)));
        all
    }

    /// Cycles of each function of the image in all of thread and interrupts, most first.
    pub fn functions(&self) -> Vec<(String, u64)> {
        let mut sums = BTreeMap::new();
        for context in self.below.values() {
            for (name, node) in &context.below {
                *sums.entry(name.clone()).or_default() += node.cycles;
            }
        }
        most_first(sums)
    }

    /// Own cycles of each inlined function with the function of the image that it is in, most
    /// first.
    pub fn inlined(&self) -> Vec<((String, String), u64)> {
        fn visit(node: &Node, into: &str, sums: &mut BTreeMap<(String, String), u64>) {
            for (name, node) in &node.below {
                *sums.entry((name.clone(), into.to_owned())).or_default() += node.own();
                visit(node, into, sums);
            }
        }
        let mut sums = BTreeMap::new();
        for context in self.below.values() {
            for (name, node) in &context.below {
                visit(node, name, &mut sums);
            }
        }
        most_first(sums)
    }
}

fn most_first<K: Ord>(sums: BTreeMap<K, u64>) -> Vec<(K, u64)> {
    let mut all: Vec<_> = sums.into_iter().filter(|(_, cycles)| *cycles > 0).collect();
    all.sort_by_key(|(_, cycles)| std::cmp::Reverse(*cycles));
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_cycle_is_in_one_function() {
        let mut root = Node::default();
        let path = |names: &[&str]| names.iter().map(|&name| name.to_owned()).collect::<Vec<_>>();
        root.add(5, &path(&["thread", "main"]));
        root.add(3, &path(&["thread", "main", "step", "filter"]));
        root.add(2, &path(&["interrupt USB", "poll"]));
        assert_eq!(root.cycles, 10);
        assert_eq!(root.functions(), [("main".to_owned(), 8), ("poll".to_owned(), 2)]);
        assert_eq!(root.inlined(), [(("filter".to_owned(), "main".to_owned()), 3)]);
    }

    #[test]
    fn lines_have_the_names_of_the_data_sheet() {
        let names = [0, 15, 23, 43, 50].map(exception_name);
        let expected = ["thread", "SysTick", "interrupt USB", "interrupt I2S", "exception 50"];
        assert_eq!(names, expected);
    }
}
