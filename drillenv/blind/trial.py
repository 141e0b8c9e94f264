"""The whole trial: campaigns are made and sealed, diagnosed by processes that see nothing else, and marked."""

from __future__ import annotations

import json
import os
import platform
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from concurrent.futures.process import ProcessPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import drillenv
from drillenv.blind import marking
from drillenv.blind.body import make_body_campaign, plan_bodies
from drillenv.blind.campaigns import Made, Planned, make_campaign, plan, plan_curves, plan_nulls
from drillenv.blind.confined import PEEKED
from drillenv.blind.detection import detection_curves
from drillenv.blind.seal import answers_digest, digest, digest_of_folder, seal, sealed, unseal
from drillenv.checks import InputError, choice, count, number, shown
from drillenv.files import made_folder, whole
from drillenv.recordings import write_campaign

FORMAT = "drillenv-trial/1"
LIMIT = 300.0
"""s of processor time that a diagnosis has; past that it has given no answer."""
PATIENCE = 3.0
"""Times the limit that it may take by the clock."""
DRILL, ONE_BODY = "percussive-drill", "one-body"
"""Rigs, as the recording format names them."""
GROUPS, CURVES, NULLS = "groups", "curves", "nulls"
PLANS = {GROUPS: plan, CURVES: plan_curves, NULLS: plan_nulls}
"""Kinds of trials, with what deals their campaigns."""
Note = Callable[[str], object]


def prove(
    folder: str | os.PathLike[str],
    seed: int = 0,
    campaigns: int = 60,
    jobs: int | None = None,
    limit: float = LIMIT,
    cluster: str | None = None,
    kind: str = GROUPS,
    rig: str = DRILL,
    note: Note | None = None,
    progress: bool = False,
) -> dict[str, Any]:
    """Run a blind trial, or go on with one that was interrupted, and write ``trial.json`` and ``trial.html``.

    Args:
        folder: Of the trial; made where there is none.
        seed: All randomness comes from it.
        campaigns: How many, 1 to 10,000; of detection curves, for each mechanism and strength.
        jobs: Campaigns made and diagnosed side by side; as many as there are cores where not given.
        limit: s of processor time for each diagnosis.
        cluster: Address of a Ray cluster that diagnoses, or "local".
        kind: "groups", as the rules say; "curves", detection curves: each mechanism alone, at strengths from full
            downwards; "nulls", false alarms: nothing is missing, and by turns a constant is wrong.
        rig: "percussive-drill", or "one-body": single bodies, shaken or on a driven axis.
        note: Told what happens.
        progress: Draw a progress bar.

    Returns:
        What ``trial.json`` holds.

    Raises:
        InputError: a value out of range, a folder that holds another trial or something else, or answers or reports
            that were changed in between.
    """
    place = Path(folder).resolve()
    count("seed", seed, 0, 2**31)
    count("campaigns", campaigns, 1, 10_000)
    number("limit", limit, 1.0, 1e5, "s")
    workers = count("jobs", jobs if jobs is not None else len(os.sched_getaffinity(0)), 1, 1024)
    say = note if note is not None else _silent
    wanted = {"format": FORMAT, "seed": seed, "campaigns": campaigns, "limit": limit, "version": drillenv.__version__}
    if choice("kind", kind, tuple(PLANS)) != GROUPS and choice("rig", rig, (DRILL, ONE_BODY)) == ONE_BODY:
        raise InputError(f"{kind} are of the drilling rig: leave out one of rig and {kind}")
    # what every trial had before there were these says nothing of them
    wanted |= ({"rig": rig} if rig == ONE_BODY else {}) | ({kind: True} if kind != GROUPS else {})
    _begin(place, wanted)
    planned = _planned(wanted)
    hash_of_answers = sealed(place)
    if hash_of_answers is None:
        say(f"making {len(planned)} campaigns")
        hash_of_answers = seal(place, _make(place / "campaigns", wanted, planned, workers, say))
    say(f"answers sealed: SHA-256 {hash_of_answers}")
    _diagnose(place, [_name(i) for i in range(len(planned))], limit, workers, cluster, progress)
    record = mark_trial(place)
    publish(place, record)
    return record


def _diagnose(
    place: Path, names: Sequence[str], limit: float, workers: int, cluster: str | None, progress: bool
) -> None:
    """Diagnose those campaigns of a trial that have no outcome yet."""
    from tqdm import tqdm

    waiting = [name for name in names if not (place / "reports" / name / "outcome.json").exists()]
    work = [(name, place / "campaigns" / name, str(place), limit) for name in waiting]
    bar = tqdm(total=len(names), initial=len(names) - len(waiting), unit="campaign", disable=not progress)
    with bar, _mapper(workers, cluster) as mapper:
        for name, files in mapper(work):
            outcome = _keep(place / "reports" / name, files)
            bar.set_postfix_str(f"{name} {outcome['status']}, {outcome['seconds']:.0f} s")
            bar.update()


def publish(place: Path, record: Mapping[str, Any]) -> None:
    """Write trial.json and trial.html into a trial's folder."""
    from drillenv.blind.page import page

    _write(place / "trial.json", record)
    with whole(place / "trial.html") as part:
        part.write_text(page(record, place), encoding="utf-8")


def mark_trial(place: Path) -> dict[str, Any]:
    """Open the seal and mark every report of a finished trial.

    Raises:
        InputError: answers, campaigns or reports are not those of the trial.
    """
    wanted = json.loads((place / "plan.json").read_text(encoding="utf-8"))
    expected = sealed(place)
    if expected is None:
        raise InputError(f"{shown(str(place))} holds no sealed answers: run the trial first")
    answers = unseal(place, expected)
    marks = []
    for i, answer in enumerate(answers):
        name = _name(i)
        if digest_of_folder(place / "campaigns" / name) != answer["sha256"]:
            raise InputError(f"campaign {name} was changed after it was sealed: start the trial in a new folder")
        outcome, report = _read_report(place / "reports" / name)
        marks.append({"campaign": name, "report_sha256": outcome["sha256"]} | marking.mark(answer, outcome, report))
    return {
        **wanted,
        "answers_sha256": expected,
        "python": platform.python_version(),
        "summary": marking.summary(marks),
        **({"curves": detection_curves(marks)} if wanted.get("curves") else {}),
        "marks": marks,
    }


def check_trial(
    folder: str | os.PathLike[str], again: int = 0, jobs: int | None = None, note: Note | None = None
) -> None:
    """Check a finished trial: make its campaigns again from the seed, mark it again, and diagnose some campaigns again.

    Args:
        folder: Of the trial.
        again: How many campaigns are diagnosed again, evenly spread; their verdicts and findings have to be the same.
        jobs, note: As for :func:`prove`.

    Raises:
        InputError: answers, campaigns, reports or marks are not what the seed and the diagnosis give.
    """
    place, say = Path(folder).resolve(), note if note is not None else _silent
    record = mark_trial(place)
    try:
        published = json.loads((place / "trial.json").read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(
            f"cannot read trial.json in {shown(str(place))}: {error.strerror}; run the trial first"
        ) from None
    if json.loads(json.dumps(record["marks"])) != published["marks"]:
        raise InputError(f"trial.json in {shown(str(place))} does not say what the reports come to: it was changed")
    planned = _planned(record)
    workers = count("jobs", jobs if jobs is not None else len(os.sched_getaffinity(0)), 1, 1024)
    say(f"making {len(planned)} campaigns again")
    with tempfile.TemporaryDirectory(prefix="trial-") as temporary:
        answers = _make(Path(temporary, "campaigns"), record, planned, workers, say)
    if answers_digest(answers) != record["answers_sha256"]:
        raise InputError(
            f"the answers in {shown(str(place))} are not those of seed {record['seed']}: they were changed"
        )
    chosen = [_name(round(i * (len(planned) - 1) / max(again - 1, 1))) for i in range(min(again, len(planned)))]
    for name in dict.fromkeys(chosen):
        say(f"diagnosing {name} again")
        files = diagnose_files(name, _files(place / "campaigns" / name), str(place), record["limit"])[1]
        outcome, report = _read_report(place / "reports" / name)
        if json.loads(files["outcome.json"])["status"] != outcome["status"] or (
            report is not None and _said(json.loads(files["report.json"])) != _said(report)
        ):
            raise InputError(f"the diagnosis of {name} now says something else than the report kept of it")


def _said(report: Mapping[str, Any]) -> tuple[str, list[str]]:
    return report["verdict"], [each["mechanism"] for each in report["findings"]]


def _planned(wanted: Mapping[str, Any]) -> list[Planned]:
    """The campaigns of a trial, by its plan."""
    if wanted.get("rig") == ONE_BODY:
        return plan_bodies(wanted["seed"], wanted["campaigns"])
    kind = next((each for each in PLANS if wanted.get(each)), GROUPS)
    return PLANS[kind](wanted["seed"], wanted["campaigns"])


def _silent(text: str) -> None:
    """For those who do not want to be told."""


def _name(i: int) -> str:
    return f"c{i + 1:04d}"


def _begin(place: Path, wanted: Mapping[str, Any]) -> None:
    """Make the folder, or find that it holds this very trial."""
    path = place / "plan.json"
    if path.exists():
        found = json.loads(path.read_text(encoding="utf-8"))
        if found != dict(wanted):
            differs = ", ".join(f"{key} {found.get(key)}" for key in wanted if found.get(key) != wanted[key])
            raise InputError(f"{shown(str(place))} holds a trial with {differs}: give another folder")
        return
    if place.exists() and (not place.is_dir() or any(place.iterdir())):
        raise InputError(f"{shown(str(place))} exists and holds no trial: give a new folder")
    made_folder(place)
    _write(path, wanted)


def _write(path: Path, record: Any) -> None:
    with whole(path) as part:
        part.write_text(json.dumps(record, indent=1, allow_nan=False) + "\n", encoding="utf-8")


# --- Making


def _make(
    place: Path, wanted: Mapping[str, Any], planned: Sequence[Planned], workers: int, say: Note
) -> list[dict[str, Any]]:
    """Make all campaigns in a folder, and give their answers."""
    make = make_body_campaign if wanted.get("rig") == ONE_BODY else make_campaign
    shutil.rmtree(place, ignore_errors=True)
    place.mkdir()
    answers: list[dict[str, Any]] = [{} for _ in planned]
    with ProcessPoolExecutor(workers) as pool:
        jobs = {pool.submit(_make_one, make, str(place), wanted["seed"], i, each): i for i, each in enumerate(planned)}
        for done, job in enumerate(as_completed(jobs), start=1):
            answers[jobs[job]] = job.result()
            if done % 10 == 0:
                say(f"made {done} of {len(planned)}")
    return answers


def _make_one(
    make: Callable[[int, int, Planned], Made], place: str, seed: int, i: int, planned: Planned
) -> dict[str, Any]:
    """Make one campaign, and give its answer with the digest of its folder."""
    made = make(seed, i, planned)
    target = Path(place) / _name(i)
    campaign = made.campaign
    file_format = ("csv", "h5")[i % 2]
    write_campaign(target, campaign.title, campaign.rig, campaign.nominal, campaign.recordings, file_format)
    return {"campaign": _name(i), "sha256": digest_of_folder(target), **made.answer}


# --- Diagnosing

Files = dict[str, bytes]


def _files(folder: Path) -> Files:
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir())}


def diagnose_files(name: str, files: Files, trial: str, limit: float) -> tuple[str, Files]:
    """Diagnose one campaign, given as files, in a folder and a process of its own.

    Returns:
        The name, and the files that the diagnosis wrote, with ``outcome.json``: status, processor seconds and memory.
    """
    with tempfile.TemporaryDirectory(prefix="campaign-") as temporary:
        campaign, out = Path(temporary, "campaign"), Path(temporary, "out")
        campaign.mkdir()
        for each, data in files.items():
            (campaign / each).write_bytes(data)
        command = [sys.executable, "-m", "drillenv.blind.confined", str(campaign), str(out), trial, str(limit)]
        threads = dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"), "1")
        begin = time.monotonic()
        with open(Path(temporary, "said"), "wb") as said:
            process = subprocess.Popen(
                command, cwd=temporary, stdin=subprocess.DEVNULL, stdout=said, stderr=said, env=os.environ | threads
            )
            code, used = _waited(process, PATIENCE * limit)
        made = {path.name: path.read_bytes() for path in out.iterdir() if path.is_file()} if out.is_dir() else {}
        status = _status(code, made)
        outcome = {
            "status": status,
            "seconds": round(used.ru_utime + used.ru_stime, 2),
            "clock_seconds": round(time.monotonic() - begin, 2),
            "memory_mib": round(used.ru_maxrss / 1024.0, 1),
            "sha256": digest(made["report.json"]) if status == "answered" else None,
            "said": Path(temporary, "said").read_text(encoding="utf-8", errors="replace")[-2000:],
        }
    return name, made | {"outcome.json": (json.dumps(outcome, indent=1) + "\n").encode()}


def _waited(process: subprocess.Popen, longest: float) -> tuple[int, Any]:
    """The exit code of a process, ended where it takes too long, and what it used."""
    end = time.monotonic() + longest
    while True:
        pid, status, used = os.wait4(process.pid, os.WNOHANG)
        if pid:
            process.returncode = os.waitstatus_to_exitcode(status)
            return process.returncode, used
        if time.monotonic() > end:
            process.kill()
            end = float("inf")
        time.sleep(0.05)


def _status(code: int, made: Mapping[str, bytes]) -> str:
    if code == PEEKED:
        return "peeked"
    if code in (-signal.SIGXCPU, -signal.SIGKILL):
        return "out of time"
    if code == 0 and "report.json" in made:
        return "answered"
    return "refused" if code == 2 else "failed"


def _keep(folder: Path, files: Files) -> dict[str, Any]:
    """Keep what a diagnosis wrote, its outcome last: where that is, all is there."""
    folder.mkdir(parents=True, exist_ok=True)
    for name in sorted(files, key=lambda each: each == "outcome.json"):
        with whole(folder / name) as part:
            part.write_bytes(files[name])
    return json.loads(files["outcome.json"])


def _read_report(folder: Path) -> tuple[dict[str, Any], dict[str, Any] | None]:
    """Outcome and report of a diagnosis.

    Raises:
        InputError: the report is not the one that the diagnosis wrote.
    """
    try:
        outcome = json.loads((folder / "outcome.json").read_text(encoding="utf-8"))
        if outcome["status"] != "answered":
            return outcome, None
        data = (folder / "report.json").read_bytes()
    except OSError as error:
        raise InputError(f"cannot read {shown(str(folder))}: {error.strerror}; run the trial to its end") from None
    if digest(data) != outcome["sha256"]:
        raise InputError(
            f"the report in {shown(str(folder))} was changed after the diagnosis: delete the folder and run on"
        )
    return outcome, json.loads(data)


Work = Sequence[tuple[str, Path, str, float]]
"""Names, folders, the trial's folder and the limit."""


def _diagnose_folder(name: str, folder: Path, trial: str, limit: float) -> tuple[str, Files]:
    return diagnose_files(name, _files(folder), trial, limit)


@contextmanager
def _mapper(workers: int, cluster: str | None) -> Iterator[Callable[[Work], Iterator[tuple[str, Files]]]]:
    """Something that diagnoses campaigns side by side, and gives the results as they come."""
    if cluster is None:
        pool = ThreadPoolExecutor(workers)
        try:
            yield lambda work: (
                each.result() for each in as_completed([pool.submit(_diagnose_folder, *item) for item in work])
            )
        finally:
            pool.shutdown(wait=True, cancel_futures=True)
        return
    try:
        import ray
    except ImportError:
        raise InputError("Ray is not installed: pip install 'drillenv[cluster]'") from None
    started = not ray.is_initialized()
    if started:
        ray.init(address=None if cluster == "local" else cluster, log_to_driver=False)
    remote = ray.remote(num_cpus=1)(diagnose_files)

    def over(work: Work) -> Iterator[tuple[str, Files]]:
        # twice as many as the cluster works on are handed over at a time, so that no store holds all campaigns
        most, running = 2 * max(1, int(ray.cluster_resources().get("CPU", 1))), []
        for name, folder, trial, limit in work:
            running.append(remote.remote(name, _files(folder), trial, limit))
            if len(running) >= most:
                ready, running = ray.wait(running)
                yield from ray.get(ready)
        while running:
            ready, running = ray.wait(running)
            yield from ray.get(ready)

    try:
        yield over
    finally:
        if started:
            ray.shutdown()
