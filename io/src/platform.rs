//! Calls of the operating system for which the standard library has no common name: those of Unix, and their counterparts on Windows.

use std::fs::{File, FileType, Metadata};
use std::io;
#[cfg(unix)]
use std::os::unix::fs::{FileTypeExt, MetadataExt};
use std::path::Path;

#[cfg(unix)]
use rustix::fs::{Mode, OFlags};
#[cfg(unix)]
use rustix::io::Errno;

/// Bytes of a block in which Unix counts the room that a file takes.
#[cfg(unix)]
const BLOCK: u64 = 512;

/// Identity of a file, whatever its name: device and inode on Unix, volume and index on Windows.
#[derive(Debug, PartialEq, Eq)]
pub struct FileIdentity(#[cfg(unix)] (u64, u64), #[cfg(windows)] same_file::Handle);

impl FileIdentity {
    /// The identity of an open file.
    ///
    /// # Errors
    /// The system does not tell.
    pub fn of(file: &File) -> io::Result<Self> {
        #[cfg(unix)]
        {
            file.metadata().map(|about| Self((about.dev(), about.ino())))
        }
        #[cfg(windows)]
        {
            same_file::Handle::from_file(file.try_clone()?).map(Self)
        }
    }

    /// The identity of the file that a path names, directly or by links.
    ///
    /// # Errors
    /// No file has this name, or the system does not tell.
    pub fn named(path: &Path) -> io::Result<Self> {
        #[cfg(unix)]
        {
            std::fs::metadata(path).map(|about| Self((about.dev(), about.ino())))
        }
        #[cfg(windows)]
        {
            same_file::Handle::from_path(path).map(Self)
        }
    }
}

/// Names the kind of thing that is no regular file.
pub(crate) fn kind_in_words(kind: FileType) -> &'static str {
    #[cfg(unix)]
    if kind.is_fifo() {
        return "a pipe";
    } else if kind.is_socket() {
        return "a socket";
    }
    if kind.is_dir() { "a folder" } else { "a device" }
}

/// Opens a named pipe for writing, without waiting for a program that reads it; `None` if the file is no pipe, as always on Windows, where
/// pipes have no names among those of files.
///
/// # Errors
/// No program reads it.
pub fn open_pipe_to_write(path: &Path) -> Option<io::Result<File>> {
    #[cfg(unix)]
    {
        if !std::fs::metadata(path).is_ok_and(|about| about.file_type().is_fifo()) {
            return None;
        }
        // To open a pipe so fails at once where nobody reads. It is opened only once: a reader takes the end of a writer for the end
        // of all, and the next opening would wait for another reader.
        let flags = OFlags::WRONLY | OFlags::NONBLOCK | OFlags::CLOEXEC;
        let opened = rustix::fs::open(path, flags, Mode::empty()).and_then(|pipe| {
            rustix::fs::fcntl_setfl(&pipe, OFlags::WRONLY)?;
            Ok(File::from(pipe))
        });
        Some(opened.map_err(Into::into))
    }
    #[cfg(windows)]
    {
        let _ = path;
        None
    }
}

/// Whether the links of a path lead back to themselves.
pub(crate) fn is_loop_of_links(error: &io::Error) -> bool {
    #[cfg(unix)]
    const LOOP: i32 = Errno::LOOP.raw_os_error();
    #[cfg(windows)]
    const LOOP: i32 = 1921; // ERROR_CANT_RESOLVE_FILENAME
    error.raw_os_error() == Some(LOOP)
}

/// Whether the process, or the machine, has as many files open as it may.
pub fn is_out_of_files(error: &io::Error) -> bool {
    #[cfg(unix)]
    const TOO_MANY: [i32; 2] = [Errno::MFILE.raw_os_error(), Errno::NFILE.raw_os_error()];
    #[cfg(windows)]
    const TOO_MANY: [i32; 1] = [4]; // ERROR_TOO_MANY_OPEN_FILES
    match error.raw_os_error() {
        Some(number) => TOO_MANY.contains(&number),
        // HDF5 tells in words alone.
        None => error.to_string().contains("Too many open files"),
    }
}

/// Room that a file takes on the disk [bytes]; on Windows its length.
pub fn room_taken(about: &Metadata) -> u64 {
    #[cfg(unix)]
    {
        about.blocks() * BLOCK
    }
    #[cfg(windows)]
    {
        about.len()
    }
}

/// Number of the user to whom a file belongs; `None` on Windows, whose users have no numbers.
pub fn user_of(about: &Metadata) -> Option<u32> {
    #[cfg(unix)]
    {
        Some(about.uid())
    }
    #[cfg(windows)]
    {
        let _ = about;
        None
    }
}

/// Processor time that all threads of this process have used [s].
pub fn processor_seconds() -> f64 {
    #[cfg(unix)]
    {
        let time = rustix::time::clock_gettime(rustix::time::ClockId::ProcessCPUTime);
        time.tv_sec as f64 + time.tv_nsec as f64 / 1e9
    }
    #[cfg(windows)]
    {
        windows::processor_seconds()
    }
}

#[cfg(windows)]
mod windows {
    #![allow(unsafe_code)] // The standard library does not tell the times of this process.

    use windows_sys::Win32::Foundation::FILETIME;
    use windows_sys::Win32::System::Threading::{GetCurrentProcess, GetProcessTimes};

    /// Unit in which Windows counts time [s].
    const TICK: f64 = 1e-7;

    pub(super) fn processor_seconds() -> f64 {
        let [mut created, mut ended, mut kernel, mut user] = [FILETIME::default(); 4];
        // SAFETY: the handle of this process is always valid, and the times are written into places that live until the call returns.
        unsafe { GetProcessTimes(GetCurrentProcess(), &mut created, &mut ended, &mut kernel, &mut user) };
        let ticks = |time: FILETIME| (u64::from(time.dwHighDateTime) << 32 | u64::from(time.dwLowDateTime)) as f64;
        (ticks(kernel) + ticks(user)) * TICK
    }
}
