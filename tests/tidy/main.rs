//! Rules of the source tree that no compiler checks: what each crate may depend on, how long files and functions may get,
//! which words and numbers may not appear, and that the documentation names only what exists.

mod citations;
mod core_rules;
mod counts;
mod crate_examples;
mod curves_picture;
mod dependencies;
mod doc_comments;
mod docs;
mod effects_page;
mod facade;
mod layers;
mod limits;
mod pages;
mod scene_page;
mod size;
mod tree;
mod warnings_page;
mod words;
