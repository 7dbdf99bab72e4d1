//! Drapery command. 
fn main() {}
