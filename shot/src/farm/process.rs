//! Process of a machine: the identity by which a lock names its owner, and whether that process is still there.

use std::fs;

use serde::{Deserialize, Serialize};

/// A process, so that no other one can be taken for it: a number is used again once its process has ended.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Owner {
    /// Name of the machine.
    pub host: String,
    /// Number of the process.
    pub pid: u32,
    /// When it started, in clock ticks since the machine did; 0 where the system does not say.
    pub started: u64,
    /// Run of the machine's kernel, another one after every start; empty where the system does not say.
    pub boot: String,
    /// Space in which the number counts: two containers of one machine number their processes independently.
    pub namespace: String,
}

impl Owner {
    /// The process that asks.
    pub fn this_process() -> Self {
        let line = |path: &str| fs::read_to_string(path).unwrap_or_default().trim().to_owned();
        let namespace = fs::read_link("/proc/self/ns/pid").map(|link| link.to_string_lossy().into_owned());
        Self {
            host: gethostname::gethostname().to_string_lossy().into_owned(),
            pid: std::process::id(),
            started: started(std::process::id()).unwrap_or_default(),
            boot: line("/proc/sys/kernel/random/boot_id"),
            namespace: namespace.unwrap_or_default(),
        }
    }

    /// Whether this process can see the other one, if that still exists.
    pub(crate) fn sees(&self, other: &Self) -> bool {
        !self.boot.is_empty() && self.boot == other.boot && self.namespace == other.namespace
    }

    /// Whether the process exists. Only meaningful for one that is seen.
    pub(crate) fn is_running(&self) -> bool {
        started(self.pid) == Some(self.started)
    }
}

impl std::fmt::Display for Owner {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}:{}", self.host, self.pid)
    }
}

/// Start of a process in clock ticks since the machine's; `None` if it has ended, also while nobody took note of that.
fn started(pid: u32) -> Option<u64> {
    let text = fs::read_to_string(format!("/proc/{pid}/stat")).ok()?;
    // The second field is the program's name, which may hold spaces and parentheses. Field 3 is the state, 22 the start.
    let (_, rest) = text.rsplit_once(')')?;
    let fields: Vec<&str> = rest.split_whitespace().collect();
    let ended = matches!(*fields.first()?, "Z" | "X");
    fields.get(19)?.parse().ok().filter(|_| !ended)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_process_is_known_by_its_number_and_its_start() {
        let me = Owner::this_process();
        assert!(me.started > 0 && me.sees(&me) && me.is_running(), "{me:?}");
        assert!(!Owner { started: me.started + 1, ..me.clone() }.is_running());
        assert!(!me.sees(&Owner { boot: "another start".into(), ..me.clone() }));
        assert!(!me.sees(&Owner { namespace: "another container".into(), ..me.clone() }));
    }

    #[test]
    fn a_killed_process_is_gone_before_its_parent_takes_note() {
        let mut child = std::process::Command::new("sleep").arg("1000").spawn().unwrap();
        let pid = child.id();
        let owner = Owner { pid, started: started(pid).unwrap(), ..Owner::this_process() };
        assert!(owner.is_running());
        child.kill().unwrap();
        while owner.is_running() {
            std::thread::yield_now();
        }
        child.wait().unwrap();
        assert!(!owner.is_running());
    }
}
