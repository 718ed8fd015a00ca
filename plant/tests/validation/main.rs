//! The thesis' validations of its model (figures 5.8 to 5.13), repeated on the right equations, and
//! the balances of energy and momentum, which a wrong equation does not pass.
//! `docs/explanation/model.md` has the table, and why two of the figures cannot be reproduced.

mod checks;
#[path = "../reference_states/newton_euler.rs"]
mod newton_euler;
mod printed;
mod runs;

#[test]
fn every_check_holds_and_stands_in_the_document() {
    let checks = checks::all(&runs::Runs::new());
    let table: String = checks.iter().map(checks::Check::row).collect();
    let failed: Vec<_> =
        checks.iter().filter(|check| !check.holds()).map(checks::Check::row).collect();
    assert!(failed.is_empty(), "{}", failed.concat());
    let document = include_str!("../../../docs/explanation/model.md");
    assert!(document.contains(&table), "docs/explanation/model.md is to have these rows:\n{table}");
}
