//! What the fuzz targets share: a bound on memory, files in a folder that each input finds empty, bytes taken apart.

pub mod edits;
pub mod layout;
pub mod memory;
pub mod scratch;
