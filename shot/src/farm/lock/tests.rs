use super::*;
use drapery_io::error::IoErrorKind;
use std::process::Command;

const NOW: u64 = 1_800_000_000;

fn at(seconds: u64) -> SystemTime {
    SystemTime::UNIX_EPOCH + Duration::from_secs(seconds)
}

fn me() -> Owner {
    Owner::this_process()
}

/// A process of this machine that has ended.
fn ended() -> Owner {
    let mut child = Command::new("true").spawn().unwrap();
    let pid = child.id();
    child.wait().unwrap();
    Owner { pid, started: 1, ..me() }
}

fn elsewhere() -> Owner {
    Owner { host: "render042".into(), pid: 4711, started: 5, boot: "another".into(), namespace: "pid:[1]".into() }
}

/// A lock that nobody gives back.
fn leave(folder: &Path, owner: &Owner, heartbeat: u64) {
    fs::write(folder.join(LOCK), content(owner, at(heartbeat))).unwrap();
}

fn take(folder: &Path, steal: bool) -> Result<RunLock, IoError> {
    RunLock::take(folder, &me(), steal, at(NOW))
}

fn names(folder: &Path) -> Vec<String> {
    fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect()
}

#[test]
fn a_second_run_is_refused_until_the_first_gives_the_folder_back() {
    let folder = tempfile::tempdir().unwrap();
    let first = take(folder.path(), false).unwrap();
    assert!(first.still_mine() && first.check().is_ok() && first.former().is_none());
    assert_eq!(names(folder.path()), [LOCK]);
    let refused = RunLock::take(folder.path(), &me(), false, at(NOW + 7)).unwrap_err();
    let place = format!("run in progress by {}, last heartbeat 7 s ago", me());
    assert!(refused.to_string().contains(&place), "{refused}");
    assert_eq!(refused.kind(), drapery_io::error::IoErrorKind::CannotCreate);
    drop(first);
    assert_eq!(names(folder.path()), [""; 0]);
    take(folder.path(), false).unwrap();
}

#[test]
fn the_lock_of_a_process_that_has_ended_is_taken_over() {
    let folder = tempfile::tempdir().unwrap();
    let dead = ended();
    leave(folder.path(), &dead, NOW);
    let seen = holder(folder.path(), at(NOW + 3)).unwrap().unwrap();
    assert_eq!((seen.presence, seen.silent_for.as_secs()), (Presence::Gone, 3));
    let lock = take(folder.path(), false).unwrap();
    assert_eq!(lock.former().unwrap().owner, Some(dead));
    assert!(lock.still_mine());
    assert_eq!(names(folder.path()), [LOCK]);
}

#[test]
fn a_number_that_was_used_again_is_not_taken_for_the_old_process() {
    let folder = tempfile::tempdir().unwrap();
    let before = Owner { started: me().started - 1, ..me() };
    leave(folder.path(), &before, NOW);
    assert!(take(folder.path(), false).is_ok());
}

#[test]
fn a_run_elsewhere_is_never_pushed_aside_unasked() {
    let folder = tempfile::tempdir().unwrap();
    leave(folder.path(), &elsewhere(), NOW - 179);
    let lately = take(folder.path(), false).unwrap_err().to_string();
    assert!(lately.contains("in progress by render042:4711, last heartbeat 179 s ago"), "{lately}");
    assert!(!lately.contains("--steal-lock"), "{lately}");
    leave(folder.path(), &elsewhere(), NOW - 180);
    let silent = take(folder.path(), false).unwrap_err().to_string();
    assert!(silent.contains("probably dead") && silent.contains("--steal-lock"), "{silent}");
    let lock = take(folder.path(), true).unwrap();
    assert_eq!(lock.former().unwrap().presence, Presence::Silent);
}

#[test]
fn a_heartbeat_far_in_the_future_is_said_to_be_one_with_the_way_out() {
    let folder = tempfile::tempdir().unwrap();
    leave(folder.path(), &elsewhere(), NOW + 3600);
    let ahead = take(folder.path(), false).unwrap_err().to_string();
    assert!(ahead.contains("3600 s in the future") && ahead.contains("--steal-lock"), "{ahead}");
    // Clocks of a farm are not the same to the second.
    leave(folder.path(), &elsewhere(), NOW + 20);
    assert!(!take(folder.path(), false).unwrap_err().to_string().contains("future"));
}

#[test]
fn a_container_of_this_machine_is_judged_by_its_heartbeat_and_a_restart_of_it_ends_everything() {
    let folder = tempfile::tempdir().unwrap();
    let container = Owner { namespace: "pid:[1]".into(), ..ended() };
    leave(folder.path(), &container, NOW - 100);
    assert!(take(folder.path(), false).is_err());
    let before_restart = Owner { boot: "before".into(), ..me() };
    leave(folder.path(), &before_restart, NOW - 100);
    assert!(take(folder.path(), false).is_err(), "another machine may have the same name");
    leave(folder.path(), &before_restart, NOW - 200);
    assert!(take(folder.path(), false).is_ok());
}

#[test]
fn a_lock_that_cannot_be_understood_is_judged_by_its_age() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join(LOCK), "").unwrap();
    let written = fs::metadata(folder.path().join(LOCK)).unwrap().modified().unwrap();
    let take_after = |age| RunLock::take(folder.path(), &me(), false, written + age).unwrap_err().to_string();
    assert!(take_after(DEAD_AFTER / 2).contains("in progress by an unknown process"));
    assert!(take_after(DEAD_AFTER).contains("--steal-lock"));
    assert!(take_after(DEAD_AFTER).contains("lock.json is damaged"));
    // So is one whose heartbeat is no time.
    let text = content(&elsewhere(), at(NOW)).replace(&NOW.to_string(), &u64::MAX.to_string());
    fs::write(folder.path().join(LOCK), text).unwrap();
    let written = fs::metadata(folder.path().join(LOCK)).unwrap().modified().unwrap();
    let refused = RunLock::take(folder.path(), &me(), false, written + DEAD_AFTER).unwrap_err().to_string();
    assert!(refused.contains("--steal-lock"), "{refused}");
}

#[test]
fn a_run_whose_lock_was_stolen_notices_and_leaves_the_new_one_alone() {
    let folder = tempfile::tempdir().unwrap();
    let first = RunLock::take_beating(folder.path(), &me(), false, at(NOW), Duration::from_millis(1)).unwrap();
    let thief = RunLock::take(folder.path(), &elsewhere(), true, at(NOW)).unwrap();
    assert_eq!(thief.former().unwrap().owner, Some(me()));
    assert!(!first.still_mine());
    let lost = first.check().unwrap_err().to_string();
    assert!(lost.contains("render042:4711"), "{lost}");
    drop(first);
    assert!(thief.still_mine());
    let seen = holder(folder.path(), at(NOW)).unwrap().unwrap();
    assert_eq!(seen.owner, Some(elsewhere()));
}

#[test]
fn a_lock_that_was_deleted_is_lost() {
    let folder = tempfile::tempdir().unwrap();
    let lock = take(folder.path(), false).unwrap();
    fs::remove_file(folder.path().join(LOCK)).unwrap();
    assert!(!lock.still_mine());
    let gone = lock.check().unwrap_err();
    assert!(matches!(gone, IoError::LockGone { is_folder: false, .. }) && gone.kind() == IoErrorKind::Io, "{gone}");
    // Also when the folder is free for others in between.
    fs::write(folder.path().join(LOCK), "").unwrap();
    assert!(!lock.still_mine());
    assert!(lock.check().unwrap_err().to_string().contains("another run has taken over this folder"));
}

#[test]
fn a_folder_that_was_renamed_is_not_said_to_be_taken_over() {
    let above = tempfile::tempdir().unwrap();
    let [folder, renamed] = ["out", "elsewhere"].map(|name| above.path().join(name));
    let lock = take(&folder, false).unwrap();
    fs::rename(&folder, &renamed).unwrap();
    let gone = lock.check().unwrap_err();
    assert_eq!(gone.kind(), IoErrorKind::Io, "{gone}");
    assert!(gone.to_string().contains("out: another program has removed or renamed this folder"), "{gone}");
}

#[test]
fn heartbeats_go_on_while_nobody_asks() {
    let folder = tempfile::tempdir().unwrap();
    // Taken in the past: the first heartbeat brings the time of today.
    let lock = RunLock::take_beating(folder.path(), &me(), false, at(1000), Duration::from_millis(1)).unwrap();
    let read = || serde_json::from_slice::<Record>(&fs::read(folder.path().join(LOCK)).unwrap());
    let today = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap().as_secs();
    // The file can be understood at every moment.
    while read().unwrap().heartbeat == 1000 {
        std::thread::yield_now();
    }
    let record = read().unwrap();
    assert!(record.heartbeat >= today, "{record:?}");
    assert_eq!(record.owner, me());
    drop(lock);
}

/// Starts many runs at once; returns how many were let in, and how many of them hold the folder in the end.
fn starters(folder: &Path, steal: bool) -> (usize, usize) {
    let barrier = std::sync::Barrier::new(8);
    let start = || {
        barrier.wait();
        take(folder, steal)
    };
    std::thread::scope(|scope| {
        let all: Vec<_> = (0..8).map(|_| scope.spawn(start)).collect();
        // All are over before the first is given back.
        let all: Vec<_> = all.into_iter().map(|one| one.join().unwrap()).collect();
        let holding = all.iter().flatten().filter(|lock| lock.still_mine()).count();
        (all.iter().flatten().count(), holding)
    })
}

#[test]
fn one_of_many_starters_gets_a_free_or_left_folder() {
    let folder = tempfile::tempdir().unwrap();
    let dead = ended();
    for _ in 0..100 {
        assert_eq!(starters(folder.path(), false), (1, 1));
        leave(folder.path(), &dead, NOW);
        assert_eq!(starters(folder.path(), false), (1, 1));
        assert_eq!(names(folder.path()), [""; 0]);
    }
}

#[test]
fn of_many_thieves_one_keeps_the_folder_and_the_others_know() {
    let folder = tempfile::tempdir().unwrap();
    for _ in 0..20 {
        leave(folder.path(), &elsewhere(), NOW);
        assert_eq!(starters(folder.path(), true).1, 1);
    }
}

#[test]
fn a_lock_that_was_judged_before_another_took_it_over_is_not_taken_again() {
    let folder = tempfile::tempdir().unwrap();
    leave(folder.path(), &ended(), NOW);
    let path = folder.path().join(LOCK);
    let [slow, fast] = [Found::read(&path), Found::read(&path)].map(|found| found.unwrap().unwrap());
    let draft = || Draft::write(folder.path(), &me(), at(NOW)).unwrap();
    let (first, second) = (draft(), draft());
    assert!(first.replace(&path, &fast).unwrap());
    // While it is being taken over nobody else can, and afterwards it is another lock.
    assert!(!second.replace(&path, &slow).unwrap());
    drop(fast);
    assert!(!second.replace(&path, &slow).unwrap());
    assert!(is_under(&path, &first.file));
}
