//! The ground tool.
fn main() {}
