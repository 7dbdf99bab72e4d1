//! Prints points of a mesh in the world, for those who compare them with what another library makes of the same stage:
//! `usd_points FILE PRIM CODE...`.

use std::path::Path;
use std::process::ExitCode;

use drapery_usd::read::{Stage, UsdError};
use serde_json::{Value, json};

fn main() -> ExitCode {
    let words: Vec<String> = std::env::args().skip(1).collect();
    let [file, prim, codes @ ..] = words.as_slice() else {
        eprintln!("usage: usd_points FILE PRIM CODE...");
        return ExitCode::from(2);
    };
    match read(file, prim, codes) {
        Ok(text) => {
            println!("{text}");
            ExitCode::SUCCESS
        }
        Err(error) => {
            eprintln!("{error}");
            ExitCode::FAILURE
        }
    }
}

fn read(file: &str, prim: &str, codes: &[String]) -> Result<Value, UsdError> {
    let stage = Stage::open(Path::new(file))?;
    let about = stage.about();
    let places: Vec<usize> = (0..about.meshes.len()).filter(|place| about.meshes[*place].path == prim).collect();
    let chosen = stage.choose(&places)?;
    let codes = codes.iter().filter_map(|code| code.parse::<f64>().ok());
    let samples = codes.map(|code| stage.mesh(0, code)).collect::<Result<Vec<_>, _>>()?;
    Ok(json!({
        "codes": chosen.codes,
        "notes": chosen.notes,
        "points": samples.iter().map(|sample| &sample.points).collect::<Vec<_>>(),
        "indices": samples.iter().map(|sample| &sample.faces.indices).collect::<Vec<_>>(),
    }))
}
