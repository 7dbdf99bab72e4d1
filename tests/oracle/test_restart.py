"""A run that is stopped, killed or robbed of its disk goes on with the same command and ends with the same bytes.

What is expected are the bytes of the run that nobody disturbed. T1 to T14 are rows of the test matrix of restarts; T4
needs several ranks, T11 and T12 are tested elsewhere. Moments are random with a fixed seed: after a number of frames and a
part of one; where in a frame they fall depends on the machine.
"""

import json
import random
import shutil
import signal
import subprocess
import threading
import time
from pathlib import Path

import pytest

from disk_faults import ATTEMPTS, FAULTS, WRITES, Brief, one_of_each_kind, sweep
from farm import (
    BAD_INPUT, CANNOT_CREATE, DONE, MISSING_INPUT, PATIENCE, STOPPED, Moments, Reader, Shot, Whole, assert_begin_like,
    assert_same, caches, checkpoints, contents, copy, holds_folder, manifest, reaches, results, stop,
)
from restart_scenes import CLOTH, grid, make_shots


@pytest.fixture(scope="module")
def shots(tmp_path_factory, mannequin):
    return make_shots(tmp_path_factory.mktemp("scenes"), mannequin)


MATRIX = ["held", "mannequin", "twister", "two sheets"]


@pytest.fixture(scope="module")
def reader():
    judge = Reader()
    yield judge
    judge.close()


@pytest.fixture(scope="module")
def whole(shots, reader, tmp_path_factory):
    """The undisturbed run of a shot, made once."""
    finished = {}

    def of(name):
        if name not in finished:
            out = tmp_path_factory.mktemp("whole") / "out"
            begin = time.monotonic()
            shots[name].run(out, "--checkpoint-every", "1f", "--keep", 1000, threads=1)
            seconds = time.monotonic() - begin
            finished[name] = Whole(out, results(out), reader.look(out), seconds)
        return finished[name]

    return of


def goes_on(out, process, moments, sign=signal.SIGTERM):
    """Waits until a random moment, then sends a signal; returns exit code and latency."""
    moments.wait(out, process)
    return stop(process, sign)


def last_log(out):
    """The log of the last attempt."""
    return sorted((out / "logs").glob("*.log"))[-1].read_text()


# ---- T1, T2: stop and go on


@pytest.mark.parametrize("name", MATRIX)
def test_a_run_resumed_at_any_frame_gives_the_same_bytes(name, shots, whole, tmp_path):
    shot, expected = shots[name], whole(name)
    all_checkpoints = {path.name: path.read_bytes() for path in checkpoints(expected.out)}
    start = manifest(expected.out)["attempts"][0]["first_frame"]  # before the first frame, with a pre-roll
    for threads, frame in [(2, start), (2, shot.first), (3, (shot.first + shot.last) // 2), (2, shot.last - 1)]:
        if (tmp_path / str(frame)).exists():
            continue
        out = copy(expected.out, tmp_path / str(frame))
        shot.run(out, "--resume", frame, "--checkpoint-every", "1f", "--keep", 1000, threads=threads)
        assert_same(out, expected.results)
        # Not the last alone: every checkpoint on the way.
        assert {path.name: path.read_bytes() for path in checkpoints(out)} == all_checkpoints


@pytest.mark.parametrize("name", MATRIX)
def test_a_run_stopped_twice_at_random_steps_with_other_threads_each_time_gives_the_same_bytes(
    name, shots, whole, tmp_path, report_figure
):
    shot, expected = shots[name], whole(name)
    moments = Moments(f"twice {name}", shot, expected.seconds)
    for number in range(5):
        out, ends = tmp_path / str(number), []
        for threads in (1, 2):
            process = shot.start(out, "--checkpoint-every", "1f", threads=threads)
            code, _ = goes_on(out, process, moments)
            ends.append((code, checkpoints(out)[-1].name))
            assert code in (DONE, STOPPED)
        shot.run(out, threads=3)
        assert_same(out, expected.results)
        if all(code == STOPPED for code, _ in ends):
            break
    report_figure(f"stopped with {ends} of a run of {expected.seconds:.1f} s")
    assert all(code == STOPPED for code, _ in ends), "signals came after the end, again and again"


def test_a_finished_run_is_left_as_it_is(shots, whole, tmp_path):
    out = copy(whole("held").out, tmp_path / "out")
    before = contents(out)
    shots["held"].run(out, threads=3)
    assert contents(out) == before
    shots["held"].run(out, "--checkpoint-every", "1f", last=1009)
    assert contents(out) == before, "a shorter range is done, too"


def test_a_range_extended_frame_by_frame_is_that_of_one_run(shots, whole, tmp_path):
    shot = shots["held"]
    for last in (1001, 1002, 1009, 1016):
        shot.run(tmp_path / "out", last=last)
    assert_same(tmp_path / "out", whole("held").results)
    attempts = [attempt["first_frame"] for attempt in manifest(tmp_path / "out")["attempts"]]
    assert attempts == [999, 1002, 1003, 1010], "frames that were there were simulated again"


# ---- T3: writing does not disturb


@pytest.mark.parametrize(
    "options",
    [
        ["--progress", "alf", "-v"],
        ["--progress", "json", "-vv", "--checkpoint-every", "0.05s"],
        ["--progress", "tr", "-q", "--checkpoint-every", "3f", "--keep", 1],
        ["--progress", "openjd", "--pin-checkpoint", "1003,1007"],
    ],
)
def test_cadence_progress_and_words_do_not_change_a_bit(options, shots, whole, tmp_path):
    shot = shots["held"]
    command = [word for word in shot.command(tmp_path / "out") if word not in ("--progress", "none")]
    subprocess.run([*command, *map(str, options)], check=True, capture_output=True, stdin=subprocess.DEVNULL)
    assert_same(tmp_path / "out", whole("held").results)
    names = [path.name for path in checkpoints(tmp_path / "out")]
    if "--pin-checkpoint" in options:
        assert {"frame_01003.h5", "frame_01007.h5"} <= set(names)
    if "--keep" in options:
        assert len(names) == 1


# ---- T5: signals


SIGNALS = [signal.SIGTERM, signal.SIGUSR1, signal.SIGINT, signal.SIGXCPU, signal.SIGUSR2]


def test_twenty_signals_at_random_moments_lose_nothing(shots, whole, tmp_path, report_figure):
    shot, expected = shots["sheet"], whole("sheet")
    moments = Moments(5, shot, expected.seconds)
    codes, latencies, rounds, between = [], [], 0, 0
    while len(codes) < 20:
        out = tmp_path / str(rounds)
        code = STOPPED
        while code == STOPPED:
            number = len(codes)
            process = shot.start(out, threads=1 + number % 3)
            code, seconds = goes_on(out, process, moments, SIGNALS[number % 5])
            assert code in (DONE, STOPPED), process.log.read_text()[-2000:]
            codes.append(code)
            if code == STOPPED:
                latencies.append(seconds)
                between += ".step_" in checkpoints(out)[-1].name
        assert_same(out, expected.results)
        rounds += 1
    report_figure(
        f"{codes.count(STOPPED)} stops in {rounds} runs, {between} between frames; slowest {max(latencies):.2f} s"
    )
    assert between > 0 and codes.count(STOPPED) >= 10


def test_a_second_signal_stops_at_once(shots, whole, tmp_path):
    shot = shots["sheet"]
    process = shot.start(tmp_path / "out", "--checkpoint-every", "1f")
    assert reaches(tmp_path / "out", process, 1003)
    process.send_signal(signal.SIGTERM)
    code, _ = stop(process, signal.SIGINT)
    assert code == STOPPED
    shot.run(tmp_path / "out")
    assert_same(tmp_path / "out", whole("sheet").results)


def test_the_exit_code_of_a_stop_can_be_chosen(shots, tmp_path):
    process = shots["sheet"].start(tmp_path / "out", "--resumable-exit-code", "99")
    assert holds_folder(tmp_path / "out", process)
    assert stop(process, signal.SIGUSR1)[0] == 99


@pytest.mark.parametrize("how", ["touch", "command"])
def test_a_file_and_the_stop_command_stop_a_run(how, shots, whole, reader, tmp_path):
    shot, out = shots["long"], tmp_path / "out"
    process = shot.start(out)
    assert reaches(out, process, 1002)
    if how == "touch":
        (out / "control" / "stop").touch()
    else:
        subprocess.run([shot.command(out)[0], "stop", str(out)], check=True, capture_output=True)
    assert process.wait(PATIENCE) == STOPPED
    assert not list((out / "control").iterdir()), "the request is still there"
    last = manifest(out)["last_complete_frame"]
    assert 1002 <= last < shot.last
    shot.run(out, last=last + 1)
    undisturbed = tmp_path / "undisturbed"
    shot.run(undisturbed, last=last + 1, threads=1)
    assert reader.look(out)["sheet.abc"] == reader.look(undisturbed)["sheet.abc"]


def test_a_checkpoint_can_be_asked_for(shots, tmp_path):
    out = tmp_path / "out"
    process = shots["long"].start(out)
    assert reaches(out, process, 1002) and not checkpoints(out)
    (out / "control" / "checkpoint").touch()
    deadline = time.monotonic() + PATIENCE
    while not checkpoints(out):
        assert process.poll() is None and time.monotonic() < deadline
        time.sleep(0.01)
    assert not (out / "control" / "checkpoint").exists()
    assert process.poll() is None, "it goes on"
    assert stop(process, signal.SIGTERM)[0] == STOPPED


# ---- T6: kills


def killed_until_done(shot, expected, out, reader, moments):
    """Kills a run again and again until it is done; after every kill everything can be read. Returns the kills."""
    kills, code = [], None
    while code != DONE:
        process = shot.start(out, "--checkpoint-every", "1f", threads=2)
        moments.wait(out, process, part_of_start=0.1)
        code, _ = stop(process, signal.SIGKILL)
        assert code in (DONE, -signal.SIGKILL), process.log.read_text()[-2000:]
        if code != DONE and out.exists():
            kills.append(max(assert_begin_like(reader.look(out), expected.frames), default=0))
        assert len(kills) < 200, f"it does not get on: {kills}"
    assert_same(out, expected.results)
    return kills


def test_after_kills_at_random_moments_everything_opens_and_the_run_goes_on(
    shots, whole, reader, tmp_path, report_figure
):
    kills = []
    while sum(map(len, kills)) < 50:
        name = ["held", "two sheets", "twister"][len(kills) % 3]
        shot, expected = shots[name], whole(name)
        moments = Moments(f"kill {len(kills)}", shot, expected.seconds)
        kills.append(killed_until_done(shot, expected, tmp_path / str(len(kills)), reader, moments))
    report_figure(f"{sum(map(len, kills))} kills in {len(kills)} runs; frames found after them {kills}")
    assert sum(frames > 0 for run in kills for frames in run) >= 20, "hardly a kill came in between"


@pytest.mark.full
def test_after_many_kills_the_mannequin_goes_on(shots, whole, reader, tmp_path, report_figure):
    shot, expected = shots["mannequin"], whole("mannequin")
    moments = Moments(66, shot, expected.seconds)
    kills = killed_until_done(shot, expected, tmp_path / "out", reader, moments)
    report_figure(f"{len(kills)} kills")


# ---- T6: faults of the disk


@pytest.fixture(scope="module")
def faults(tmp_path_factory):
    """The library that breaks calls, and the settings for the n-th."""
    if not shutil.which("cc"):
        pytest.skip("no C compiler")
    library = tmp_path_factory.mktemp("faults") / "faults.so"
    source = Path(__file__).with_name("faults.c")
    subprocess.run(["cc", "-O1", "-shared", "-fPIC", "-o", str(library), str(source)], check=True)

    def settings(out, fault="", number=0):
        report = Path(f"{out}.calls")
        report.unlink(missing_ok=True)
        words = {"LD_PRELOAD": library, "FAULT_FOLDER": out, "FAULT_REPORT": report, "FAULT": fault, "FAULT_AT": number}
        return {name: str(word) for name, word in words.items()}

    return settings


@pytest.fixture(scope="module")
def brief(shots, faults, reader, tmp_path_factory):
    """The short run whose calls are broken."""
    folder = tmp_path_factory.mktemp("brief")
    brief = Brief(shots["held"], [folder / "0"], None, [])
    for attempt in range(len(ATTEMPTS)):
        out = folder / str(attempt + 1)
        assert brief.start(out, attempt, faults(out)).wait(PATIENCE) == DONE
        lines = Path(f"{out}.calls").read_text().splitlines()
        brief.calls += [(attempt, int(number), call, Path(path)) for number, call, path in map(str.split, lines)]
        brief.before.append(out)
    brief.mend(folder / "whole")
    brief.whole = Whole(folder / "whole", results(folder / "whole"), reader.look(folder / "whole"), 0.0)
    return brief


def test_no_fault_of_the_disk_leaves_a_torn_file_or_another_result(brief, faults, reader, tmp_path, report_figure):
    # The first four faults are for all calls, the others for those that can be done by halves.
    # Half of the kinds, by turns of the fault; `make test-full` breaks every call.
    chosen = one_of_each_kind(brief.calls, random.Random(66))[::2]
    broken = [(FAULTS[i % (6 if call in WRITES else 4)], place) for i, (call, place) in enumerate(chosen)]
    report_figure(sweep(brief, faults, reader, tmp_path, broken))


@pytest.mark.full
@pytest.mark.parametrize("fault", FAULTS)
def test_no_fault_of_any_call_leaves_a_torn_file_or_another_result(
    fault, brief, faults, reader, tmp_path, report_figure
):
    calls = [place for *place, call, _ in brief.calls if fault not in FAULTS[4:] or call in WRITES]
    report_figure(sweep(brief, faults, reader, tmp_path, [(fault, place) for place in calls]))


# ---- T7: broken checkpoints


def truncate(path):
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


def flip(path):
    whole = bytearray(path.read_bytes())
    whole[2 * len(whole) // 3] ^= 4
    path.write_bytes(whole)


def empty(path):
    path.write_bytes(b"")


@pytest.fixture(scope="module")
def half(shots, tmp_path_factory):
    """A run that was stopped in the middle, with three checkpoints."""
    out = tmp_path_factory.mktemp("half") / "out"
    shots["held"].run(out, "--checkpoint-every", "1f", last=1008)
    return out


@pytest.mark.parametrize("damage", [truncate, flip, empty])
def test_a_broken_checkpoint_is_named_and_the_one_before_is_used(damage, shots, whole, half, tmp_path):
    out = copy(half, tmp_path / "out")
    damage(out / "checkpoints" / "frame_01008.h5")
    said = shots["held"].run(out)
    assert_same(out, whole("held").results)
    assert manifest(out)["attempts"][-1]["first_frame"] == 1008
    for words in (said, last_log(out)):
        assert "frame_01008.h5" in words and "the one before" in words, words


def test_without_a_good_checkpoint_the_run_begins_anew_and_the_old_frames_are_set_aside(
    shots, whole, half, reader, tmp_path
):
    out = copy(half, tmp_path / "out")
    for damage, path in zip([truncate, flip, empty], checkpoints(out), strict=True):
        damage(path)
    said = shots["held"].run(out)
    assert manifest(out)["attempts"][-1]["first_frame"] == 999
    assert "stale" in said and "frame_01006.h5" in said, said
    assert_same(out, whole("held").results)
    (stale,) = (out / "stale").iterdir()
    for broken in stale.glob("frame_*.h5"):
        broken.unlink()
    found = reader.look(stale)
    assert {name: len(found[name]) for name in caches(out)} == dict.fromkeys(caches(out), 8)


# ---- T8: one run a folder


def test_a_second_run_is_refused_and_one_that_steals_the_lock_is_not_disturbed(shots, reader, tmp_path):
    shot, out = shots["long"], tmp_path / "out"
    first = shot.start(out)
    try:
        assert reaches(out, first, 1002)
        # It has just written a frame, and simulates the next one.
        first.send_signal(signal.SIGSTOP)
        said = shot.run(out, code=CANNOT_CREATE)
        assert str(first.pid) in said and "steal" not in said.splitlines()[0], said
        second = shot.start(out, "--steal-lock")
        assert reaches(out, second, 1004)
        assert stop(second, signal.SIGTERM)[0] == STOPPED
        before = contents(out)
        first.send_signal(signal.SIGCONT)
        code = first.wait(PATIENCE)
    finally:
        first.kill()
    words = first.log.read_text()
    assert code not in (DONE, STOPPED), f"{code} {words[-1000:]}"
    assert contents(out).keys() == before.keys()
    differing = [name for name, value in contents(out).items() if value != before[name] and "/logs/" not in name]
    assert not differing, f"the first run wrote {differing}"
    last = manifest(out)["last_complete_frame"] + 1
    shot.run(out, last=last)
    alone = tmp_path / "alone"
    shot.run(alone, last=last)
    assert reader.look(out)["sheet.abc"] == reader.look(alone)["sheet.abc"]


# ---- T9: changes


@pytest.fixture
def cloth(tmp_path):
    """A shot with a garment from a file, of which three frames are done."""
    (tmp_path / "cloth.toml").write_text(CLOTH)
    (tmp_path / "cloth.obj").write_text(grid(6))
    shot = Shot(tmp_path / "cloth.toml", "1-6")
    shot.run(tmp_path / "out", last=3)
    return shot, tmp_path / "out"


def test_a_changed_scene_is_named_and_nothing_is_touched(cloth):
    shot, out = cloth
    before = contents(out)
    shot.parameters["g"] = -1.62
    said = shot.run(out, code=CANNOT_CREATE)
    assert "gravity.acceleration" in said and "-9.81" in said and "-1.62" in said and "--resume-with-changes" in said
    assert contents(out) == before


def test_a_changed_input_is_named_and_nothing_is_touched(cloth, tmp_path):
    shot, out = cloth
    before = contents(out)
    text = (tmp_path / "cloth.obj").read_text()
    (tmp_path / "cloth.obj").write_text(text.replace("v 0.5 1.0 0.5", "v 0.5 1.0 0.51"))
    said = shot.run(out, code=CANNOT_CREATE)
    assert "cloth.obj has changed" in said and "--resume-with-changes" in said
    assert contents(out) == before


def test_a_missing_input_is_named_and_nothing_is_touched(cloth, tmp_path):
    shot, out = cloth
    before = contents(out)
    (tmp_path / "cloth.obj").unlink()
    assert "cloth.obj" in shot.run(out, code=MISSING_INPUT)
    assert contents(out) == before


def test_a_damaged_input_is_refused_and_nothing_is_touched(cloth, tmp_path):
    shot, out = cloth
    before = contents(out)
    (tmp_path / "cloth.obj").write_text("v 0 0\nf 1 2 3\n")
    assert "cloth.obj" in shot.run(out, code=BAD_INPUT)
    assert contents(out) == before


def test_with_leave_a_changed_run_goes_on_and_says_so_for_ever(cloth, reader):
    shot, out = cloth
    old = reader.look(out)
    shot.parameters["g"] = -1.62
    shot.run(out, "--resume-with-changes")
    (change,) = manifest(out)["attempts"][-1]["changes"]
    assert "gravity.acceleration" in change
    resumed = [json.loads(line) for line in (out / "run.jsonl").read_text().splitlines()]
    assert [line["changes"] for line in resumed if line["record"] == "resume"] == [[change]]
    new = reader.look(out)
    assert new["cloth.abc"][:3] == old["cloth.abc"] and len(new["cloth.abc"]) == 6


def test_frames_that_are_simulated_again_are_set_aside_and_can_be_read(cloth, reader):
    shot, out = cloth
    shot.run(out, "--checkpoint-every", "1f", "--keep", 10)
    old = reader.look(out)
    shot.parameters["g"] = -1.62
    shot.run(out, "--resume", 4, "--resume-with-changes")
    found = reader.look(out)
    (stale,) = [path for path in (out / "stale").iterdir()]
    for name in ("cloth.abc", "cloth.h5"):
        assert found[f"stale/{stale.name}/{name}"] == old[name], "the old frames are not all there"
        assert found[name][:4] == old[name][:4] and found[name][4] != old[name][4]
    assert f"stale/{stale.name}/frame_00006.h5" in found


# ---- T10: the end of the time


LIMITS = {"max-wall": None, "stop-at": "DRAPERY_STOP_AT", "job-end": "SLURM_JOB_END_TIME"}


def seconds_left(limit, shot, tmp_path):
    """Runs all kinds of limits at once, until `limit` seconds are over; returns how many were left when all had ended."""
    tmp_path.mkdir()
    begin = time.time()
    running = {}
    for reason, variable in LIMITS.items():
        options = [] if variable else ["--max-wall", f"{limit}s"]
        environment = {variable: f"{begin + limit:.3f}"} if variable else None
        running[reason] = shot.start(tmp_path / reason, *options, environment=environment, threads=1)
    for reason, process in running.items():
        assert process.wait(PATIENCE) == STOPPED, process.log.read_text()[-2000:]
    left = begin + limit - time.time()
    for reason in LIMITS:
        found = manifest(tmp_path / reason)
        assert found["attempts"][-1]["end"] == reason and checkpoints(tmp_path / reason)
    return left


def test_a_run_ends_before_its_time_is_over(shots, tmp_path, report_figure):
    # Many minutes of work. Where the machine is so loaded that a second passes between two lines of the program, the limit that a
    # farm would give is a longer one.
    shot = Shot(shots["long"].scene, "1001-1100", resolution=160)
    for limit in (6, 24, 96, 384):
        left = seconds_left(limit, shot, tmp_path / str(limit))
        report_figure(f"{left:.1f} s before the end of {limit} s")
        if left > 0:
            return
    pytest.fail("no limit was kept")


# ---- T13: hidden state


@pytest.mark.parametrize("name", MATRIX)
def test_a_resume_in_poisoned_memory_gives_the_same_bytes(name, shots, whole, tmp_path):
    shot, expected = shots[name], whole(name)
    out = copy(expected.out, tmp_path / "out")
    # Fresh memory of the C library is filled with 0x5A, freed memory with 0xA5.
    shot.run(out, "--resume", (shot.first + shot.last) // 2, environment={"MALLOC_PERTURB_": "165"})
    assert_same(out, expected.results)


# ---- T14: readers


def test_readers_never_fail_while_a_run_is_stopped_killed_and_goes_on(shots, whole, tmp_path, report_figure):
    shot, expected, out = shots["sheet"], whole("sheet"), tmp_path / "out"
    failures, seen, ended = [], [], threading.Event()

    def read():
        reader = Reader()
        try:
            while not ended.is_set():
                if out.exists():
                    seen.extend(assert_begin_like(reader.look(out), expected.frames))
        except AssertionError as error:
            failures.append(str(error))
        finally:
            reader.close()

    watcher = threading.Thread(target=read)
    watcher.start()
    moments, code, stops = Moments(14, shot, expected.seconds), None, 0
    try:
        while code != DONE:
            process = shot.start(out, "--checkpoint-every", "2f")
            sign = [signal.SIGTERM, signal.SIGKILL][stops % 2]
            code, _ = goes_on(out, process, moments, sign)
            stops += code != DONE
    finally:
        ended.set()
        watcher.join()
    assert not failures, failures
    assert_same(out, expected.results)
    report_figure(f"{len(seen)} files read in {stops + 1} attempts, with {sorted(set(seen))} frames")
    assert len(set(seen)) > 5


# ---- The tests themselves


def test_the_comparison_and_the_reader_see_a_single_bit(shots, whole, tmp_path):
    expected = whole("held")
    for name in expected.results:
        out = copy(expected.out, tmp_path / name)
        flip(next(path for path in [*caches(out).values(), *checkpoints(out)] if path.name == name))
        with pytest.raises(AssertionError):
            assert_same(out, expected.results)
        shutil.rmtree(out)


def test_the_reader_refuses_torn_files(whole, reader, tmp_path):
    for index, path in enumerate([*caches(whole("held").out).values(), *checkpoints(whole("held").out)[-1:]]):
        out = tmp_path / str(index)
        out.mkdir()
        shutil.copy(path, out)
        truncate(out / path.name)
        with pytest.raises(AssertionError):
            Reader().look(out)
