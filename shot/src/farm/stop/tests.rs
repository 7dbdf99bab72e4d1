use super::*;

const START: f64 = 1.8e9;

/// A point of time in seconds after the start.
fn at(seconds: f64) -> SystemTime {
    SystemTime::UNIX_EPOCH + Duration::from_secs_f64(START + seconds)
}

fn watching() -> (tempfile::TempDir, StopRequests) {
    let folder = tempfile::tempdir().unwrap();
    let requests = StopRequests::default();
    assert_eq!(requests.watch_folder(folder.path()).unwrap(), [""; 0]);
    (folder, requests)
}

fn touch(folder: &tempfile::TempDir, name: &str) -> PathBuf {
    let path = folder.path().join(CONTROL).join(name);
    fs::write(&path, "").unwrap();
    path
}

#[test]
fn the_first_signal_stops_with_a_checkpoint_and_the_second_at_once() {
    let requests = StopRequests::default();
    assert_eq!(requests.poll(at(0.0)), None);
    requests.clone().signal(Signal::User1, at(0.0));
    let stop = Some(Request::Stop(Reason::Signal(Signal::User1)));
    assert_eq!((requests.poll(at(0.1)), requests.poll(at(9.0))), (stop, stop));
    requests.signal(Signal::Terminate, at(10.0));
    requests.signal(Signal::Interrupt, at(11.0));
    assert_eq!(requests.poll(at(11.0)), Some(Request::StopAtOnce(Reason::Signal(Signal::Terminate))));
}

#[test]
fn a_signal_that_a_launcher_delivers_twice_counts_once() {
    let requests = StopRequests::default();
    requests.signal(Signal::Terminate, at(0.0));
    requests.signal(Signal::Terminate, at(0.4));
    assert_eq!(requests.poll(at(0.4)), Some(Request::Stop(Reason::Signal(Signal::Terminate))));
    requests.signal(Signal::Terminate, at(0.6));
    assert_eq!(requests.poll(at(0.6)), Some(Request::StopAtOnce(Reason::Signal(Signal::Terminate))));
    let other = StopRequests::default();
    other.signal(Signal::User1, at(0.0));
    other.signal(Signal::Terminate, at(0.1));
    assert_eq!(other.poll(at(0.1)), Some(Request::StopAtOnce(Reason::Signal(Signal::Terminate))));
}

#[test]
fn a_run_leaves_two_checkpoints_and_a_frame_before_its_time_is_over() {
    let requests = StopRequests::default();
    requests.deadline(Reason::MaxWall, at(36_000.0), at(0.0));
    [30.0, 40.0, 20.0].iter().for_each(|seconds| requests.note_frame(*seconds));
    [5.0, 8.0, 6.0].iter().for_each(|seconds| requests.note_checkpoint(*seconds));
    let notice = requests.notice(at(1000.0)).unwrap();
    assert_eq!((notice.reason, notice.needed, notice.left), (Reason::MaxWall, 2.0 * 8.0 + 40.0, 35_000.0));
    assert_eq!(requests.poll(at(36_000.0 - 56.1)), None);
    assert_eq!(requests.poll(at(36_000.0 - 56.0)), Some(Request::Stop(Reason::MaxWall)));
    // Ten frames later the long one no longer counts; the slow checkpoint does.
    (0..10).for_each(|_| requests.note_frame(1.0));
    assert_eq!(requests.notice(at(0.0)).unwrap().needed, 2.0 * 8.0 + 1.0);
}

#[test]
fn a_run_of_a_minute_leaves_more_than_five_seconds_early_and_a_run_of_a_second_gets_somewhere() {
    let leaves_before = |span: f64| {
        let requests = StopRequests::default();
        requests.deadline(Reason::MaxWall, at(span), at(0.0));
        let tenths = (0..).find(|tenths| requests.poll(at(f64::from(*tenths) * 0.1)).is_some());
        span - f64::from(tenths.unwrap()) * 0.1
    };
    assert!((5.5..6.5).contains(&leaves_before(60.0)), "{}", leaves_before(60.0));
    assert!((0.0..0.2).contains(&leaves_before(1.0)), "{}", leaves_before(1.0));
    assert!((9.5..10.5).contains(&leaves_before(3600.0)), "{}", leaves_before(3600.0));
}

#[test]
fn the_earliest_deadline_counts() {
    let requests = StopRequests::default();
    requests.deadline(Reason::StopAt, at(500.0), at(0.0));
    requests.deadline(Reason::JobEnd, at(400.0), at(0.0));
    requests.deadline(Reason::MaxWall, at(900.0), at(0.0));
    assert_eq!(StopRequests::default().notice(at(0.0)), None);
    // Nothing is measured yet: the least reserve.
    let notice = Notice { reason: Reason::JobEnd, needed: 10.0, left: 300.0, knows_checkpoints: false };
    assert_eq!(requests.notice(at(100.0)), Some(notice));
    assert_eq!(requests.poll(at(100.0)), None);
    assert_eq!(requests.poll(at(1000.0)), Some(Request::Stop(Reason::JobEnd)));
    let late = StopRequests::default();
    late.deadline(Reason::StopAt, at(-5.0), at(0.0));
    assert_eq!(late.poll(at(0.0)), Some(Request::Stop(Reason::StopAt)));
}

#[test]
fn a_stop_file_stops_the_run_until_it_has_ended_and_no_later_one() {
    let (folder, requests) = watching();
    let file = touch(&folder, "stop");
    let stop = Some(Request::Stop(Reason::ControlFile));
    assert_eq!((requests.poll(at(0.0)), requests.poll(at(0.1))), (stop, stop));
    // Taking the file back comes too late.
    assert!(file.exists());
    fs::remove_file(&file).unwrap();
    assert_eq!(requests.poll(at(5.0)), stop);
    touch(&folder, "stop");
    requests.finish();
    assert!(!file.exists());
}

#[test]
fn a_stop_file_that_a_killed_run_left_does_not_stop_the_next() {
    let (folder, killed) = watching();
    let file = touch(&folder, "stop");
    assert!(killed.poll(at(0.0)).is_some());
    let next = StopRequests::default();
    assert_eq!(next.watch_folder(folder.path()).unwrap(), ["stop"]);
    assert!(!file.exists());
    assert_eq!(next.poll(at(10.0)), None);
}

#[test]
fn a_checkpoint_file_asks_for_one_checkpoint() {
    let (folder, requests) = watching();
    let file = touch(&folder, "checkpoint");
    assert_eq!(requests.poll(at(0.0)), Some(Request::Checkpoint));
    assert!(!file.exists());
    assert_eq!(requests.poll(at(2.0)), None);
    touch(&folder, "checkpoint");
    assert_eq!(requests.poll(at(4.0)), Some(Request::Checkpoint));
}

#[test]
fn a_checkpoint_file_that_cannot_be_removed_is_obeyed_once() {
    let (folder, requests) = watching();
    // A folder of that name cannot be removed as a file.
    fs::create_dir(folder.path().join(CONTROL).join("checkpoint")).unwrap();
    assert_eq!(requests.poll(at(0.0)), Some(Request::Checkpoint));
    assert_eq!(requests.poll(at(2.0)), None);
}

#[test]
fn files_are_looked_for_once_a_second_also_when_the_clock_is_set_back() {
    let (folder, requests) = watching();
    assert_eq!(requests.poll(at(0.0)), None);
    touch(&folder, "stop");
    assert_eq!(requests.poll(at(0.9)), None);
    assert_eq!(requests.poll(at(1.0)), Some(Request::Stop(Reason::ControlFile)));
    let (folder, requests) = watching();
    assert_eq!(requests.poll(at(0.0)), None);
    touch(&folder, "stop");
    assert_eq!(requests.poll(at(-3600.0)), Some(Request::Stop(Reason::ControlFile)));
}

#[test]
fn a_request_from_outside_reaches_the_run_that_holds_the_folder() {
    let (folder, requests) = watching();
    let outside = |when| request_stop(folder.path(), when);
    let error = outside(at(0.0)).unwrap_err().to_string();
    assert!(error.contains("holds no run"), "{error}");
    fs::write(folder.path().join(MANIFEST), "{}").unwrap();
    assert_eq!(outside(at(0.0)).unwrap(), None);
    assert_eq!(requests.poll(at(0.0)), None);
    let me = crate::farm::process::Owner::this_process();
    let lock = lock::RunLock::take(folder.path(), &me, false, at(0.0)).unwrap();
    let asked = outside(at(1.0)).unwrap().unwrap();
    assert_eq!(asked.owner, Some(me));
    assert_eq!(requests.poll(at(2.0)), Some(Request::Stop(Reason::ControlFile)));
    requests.finish();
    drop(lock);
}
