//! The frame loop and the folder that it writes: where a run begins (`resume`), what it holds (`folder`, `output`), what it
//! leaves behind when the solver gives up (`bundle`), and the cloth after lines of a step (`dump`).

mod belts;
mod bundle;
mod continued;
mod counted;
mod dump;
mod folder;
mod frame_loop;
mod ignored;
mod input_watch;
mod kept_frames;
mod observer;
mod options;
mod output;
mod reserve;
mod resume;
mod rewritten;
mod totals;

pub use bundle::Bundle;
pub use dump::FOLDER as DUMPS;
pub use observer::{FrameReport, Observer, Outcome, RunReport};
pub use options::{Resume, RunOptions};
