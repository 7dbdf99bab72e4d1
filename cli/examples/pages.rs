//! Writes the man pages and the completions of shells into a folder, as they stand below a prefix: `pages FOLDER`. For `make dist`.

use std::fs;
use std::io::Error;
use std::path::Path;

use clap_complete::Shell;

/// Folders in which shells look for completions, below a prefix.
const SHELLS: [(Shell, &str); 3] = [
    (Shell::Bash, "share/bash-completion/completions"),
    (Shell::Zsh, "share/zsh/site-functions"),
    (Shell::Fish, "share/fish/vendor_completions.d"),
];

fn main() -> Result<(), Error> {
    let folder = std::env::args_os().nth(1).ok_or_else(|| Error::other("usage: pages FOLDER"))?;
    let folder = Path::new(&folder);
    let manuals = folder.join("share/man/man1");
    fs::create_dir_all(&manuals)?;
    clap_mangen::generate_to(drapery_command::command_line(), &manuals)?;
    for (shell, subfolder) in SHELLS {
        let pages = folder.join(subfolder);
        fs::create_dir_all(&pages)?;
        clap_complete::generate_to(shell, &mut drapery_command::command_line(), "drapery", &pages)?;
    }
    Ok(())
}
