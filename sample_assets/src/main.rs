//! `drapery-assets`: writes Drapery's sample characters.

use std::path::PathBuf;
use std::process::ExitCode;

use clap::{Parser, Subcommand, ValueEnum};

use drapery_assets::export::{Fineness, Order, write_coat, write_mannequin};

/// Makes the bodies, motions and garments of Drapery's samples.
#[derive(Debug, Parser)]
#[command(name = "drapery-assets", version)]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// A mannequin that walks and then dances, with skirt, T-shirt and trousers
    ///
    /// Writes body.abc, and for each garment .abc, .obj and, where it holds to the waist, _pins.json. Metres, y up,
    /// rest pose at the first frame. The same arguments give the same bytes.
    Mannequin(MannequinArguments),
    /// A coat as two meshes: the cloth that is simulated, and what is rendered in its place
    ///
    /// Writes coat.abc, a tube, and coat_render.abc, a shell of two layers with hems, a collar and buttons. Metres, y up.
    Coat {
        /// Folder for the files; created if it is missing
        #[arg(long, value_name = "DIR")]
        out: PathBuf,
    },
}

#[derive(Debug, Parser)]
struct MannequinArguments {
    /// Folder for the files; created if it is missing
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Points per length: 1 is a body of about 10,000 points, 2 has four times as many; 0.5 to 4
    #[arg(long, default_value_t = 1.0)]
    resolution: f64,
    /// Each seed dances a little differently; body and garments stay the same
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// First and last frame
    #[arg(long, value_name = "A-B", default_value = "1001-1097", value_parser = frame_range)]
    frames: FrameRange,
    /// Frames per second: a number or a fraction such as 24000/1001
    #[arg(long, default_value = "24", value_parser = frame_rate)]
    fps: f64,
    /// Edge length of the garments: light about 20 mm, full about 9 mm, divided by the resolution
    #[arg(long, value_enum, default_value_t = GarmentEdges::Light)]
    garments: GarmentEdges,
}

#[derive(Debug, Clone, Copy)]
struct FrameRange([u32; 2]);

#[derive(Debug, Clone, Copy, ValueEnum)]
enum GarmentEdges {
    Light,
    Full,
}

fn frame_range(text: &str) -> Result<FrameRange, String> {
    let parse = |part: &str| part.trim().parse::<u32>().map_err(|_| format!("'{part}' is not a frame number"));
    let (first, last) = text.split_once('-').ok_or("write first and last frame as A-B, for example 1001-1097")?;
    Ok(FrameRange([parse(first)?, parse(last)?]))
}

fn frame_rate(text: &str) -> Result<f64, String> {
    let parse = |part: &str| part.trim().parse::<f64>().map_err(|_| format!("'{part}' is not a number"));
    match text.split_once('/') {
        Some((frames, seconds)) => Ok(parse(frames)? / parse(seconds)?),
        None => parse(text),
    }
}

impl MannequinArguments {
    fn order(&self) -> Order {
        Order {
            resolution: self.resolution,
            seed: self.seed,
            frames: self.frames.0,
            frames_per_second: self.fps,
            garments: match self.garments {
                GarmentEdges::Light => Fineness::Light,
                GarmentEdges::Full => Fineness::Full,
            },
        }
    }
}

fn main() -> ExitCode {
    let written = match Arguments::parse().command {
        Command::Mannequin(arguments) => write_mannequin(&arguments.order(), &arguments.out),
        Command::Coat { out } => write_coat(&out),
    };
    match written {
        Ok(files) => {
            for file in files {
                println!("{}: {}", file.path.display(), file.content);
            }
            ExitCode::SUCCESS
        }
        Err(problem) => {
            eprintln!("error: {problem}");
            ExitCode::FAILURE
        }
    }
}
