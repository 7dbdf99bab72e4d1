//! Memory that this process takes, and memory that it may still take.

use std::fs;

/// Bytes that this process may still take: the least of what the machine has free, what the control group of the process leaves
/// and what its limit of address space leaves. `None` where the system does not say.
pub(crate) fn available() -> Option<u64> {
    let limits = [of_machine(), of_group(), of_address_space()];
    limits.into_iter().flatten().min()
}

/// `MemAvailable` of the kernel, which counts what caches would give back.
fn of_machine() -> Option<u64> {
    kibibytes(&fs::read_to_string("/proc/meminfo").ok()?, "MemAvailable:")
}

/// The number behind a word in the tables of `/proc`, in bytes.
fn kibibytes(table: &str, word: &str) -> Option<u64> {
    let line = table.lines().find_map(|line| line.strip_prefix(word))?;
    line.split_whitespace().next()?.parse::<u64>().ok()?.checked_mul(1024)
}

/// Returns the memory that the control groups above this process leave (version 2, in which a limit holds for
/// everything below it).
fn of_group() -> Option<u64> {
    let table = fs::read_to_string("/proc/self/cgroup").ok()?;
    let path = table.lines().find_map(|line| line.strip_prefix("0::"))?.trim_matches('/').to_owned();
    let mut folder = std::path::PathBuf::from("/sys/fs/cgroup");
    let mut left = left_in(&folder);
    for name in path.split('/').filter(|name| !name.is_empty() && *name != "..") {
        folder.push(name);
        left = [left, left_in(&folder)].into_iter().flatten().min();
    }
    left
}

fn left_in(folder: &std::path::Path) -> Option<u64> {
    let number = |file: &str| fs::read_to_string(folder.join(file)).ok()?.trim().parse::<u64>().ok();
    Some(number("memory.max")?.saturating_sub(number("memory.current")?))
}

/// Returns the address space that `ulimit -v` leaves.
fn of_address_space() -> Option<u64> {
    let limits = fs::read_to_string("/proc/self/limits").ok()?;
    let limit = limits.lines().find_map(|line| line.strip_prefix("Max address space"))?;
    let limit: u64 = limit.split_whitespace().next()?.parse().ok()?;
    let taken = memory("VmSize:")?;
    Some(limit.saturating_sub(taken))
}

/// Memory that this process occupies [bytes], where the system tells.
pub fn resident_bytes() -> Option<u64> {
    memory("VmRSS:")
}

/// Most memory that this process has occupied since its start or [`forget_peak`] [bytes], where the system tells.
pub fn peak_bytes() -> Option<u64> {
    memory("VmHWM:")
}

/// Lets [`peak_bytes`] begin again, where the system can.
pub fn forget_peak() {
    // Where it cannot, the peak of everything so far is reported.
    let _ = fs::write("/proc/self/clear_refs", "5");
}

/// Memory of this process behind a word of its status [bytes].
fn memory(word: &str) -> Option<u64> {
    kibibytes(&fs::read_to_string("/proc/self/status").ok()?, word)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_kernel_says_how_much_is_left() {
        assert_eq!(kibibytes("MemTotal: 9 kB\nMemAvailable:   2048 kB\n", "MemAvailable:"), Some(2 << 20));
        assert_eq!(kibibytes("MemTotal: 9 kB\n", "MemAvailable:"), None);
        if cfg!(target_os = "linux") {
            assert!(available().is_some_and(|bytes| bytes > 1 << 20));
        }
    }
}
