//! Exit codes, in one place. Farm software reads them; they never change their meaning.

use drapery_shot::fault::FaultKind;

/// Exit code of the program; a fault has its own number.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub(crate) enum ExitCode {
    Done = 0,
    Differences = 1,
    Usage = FaultKind::Usage as u8,
    BadInput = FaultKind::BadInput as u8,
    MissingInput = FaultKind::MissingInput as u8,
    #[cfg_attr(not(feature = "mpi"), allow(dead_code, reason = "there are no other ranks"))]
    RankLost = 69,
    Internal = FaultKind::Internal as u8,
    NoMemory = FaultKind::NoMemory as u8,
    CannotCreate = FaultKind::CannotCreate as u8,
    Io = FaultKind::Io as u8,
    Stopped = 75,
    Scene = FaultKind::Scene as u8,
    SolverGaveUp = FaultKind::SolverGaveUp as u8,
    QualityLimits = 81,
    VerificationFailed = 82,
}

/// The table that `--help` prints.
pub(crate) const TABLE: &str = "Exit codes:
   0  done
   1  differences found (diff), a case failed (selftest), or a run failed (wedge)
   2  invalid command line, or it asks for frames that the shot does not have
  65  an input file holds unusable data, or is not a regular file
  66  an input file is missing or cannot be opened
  69  a rank of several was lost (machine, network): run the same command again on machines that answer
  70  internal error
  71  not enough memory for the shot, or no more threads can be started
  73  an output could not be created, or holds another run
  74  reading or writing failed (disk full, too many open files, a file removed while it is written), including output and logs
  75  stopped early at a checkpoint: run the same command again (run --resumable-exit-code)
  78  the scene file, a material file or the site file is wrong
  80  the solver gave up
  81  quality limits exceeded (run --strict)
  82  a verified file breaks a rule";

impl From<ExitCode> for std::process::ExitCode {
    fn from(code: ExitCode) -> Self {
        Self::from(code as u8)
    }
}

impl From<FaultKind> for ExitCode {
    fn from(kind: FaultKind) -> Self {
        match kind {
            FaultKind::Usage => Self::Usage,
            FaultKind::BadInput => Self::BadInput,
            FaultKind::MissingInput => Self::MissingInput,
            FaultKind::Internal => Self::Internal,
            FaultKind::NoMemory => Self::NoMemory,
            FaultKind::CannotCreate => Self::CannotCreate,
            FaultKind::Io => Self::Io,
            FaultKind::Scene => Self::Scene,
            FaultKind::SolverGaveUp => Self::SolverGaveUp,
        }
    }
}
