"""Many runs: several at a time, each once, and only those that are not done yet. Not collective."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor, as_completed
from threading import Event

from tqdm import tqdm

from app.base.errors import InputError
from app.parameter_study.processes import perform
from app.parameter_study.run import OUTCOME, WHERE_KNOWN

# Exit statuses of app.solve with an answer, as good as it gets. What is refused depends on more than a key knows
# (memory, packages, what code opens), and costs a start; any other is a crash, and worth another try.
FINISHED = (0, 3)
_OF_PROBLEM = ("rms_height", "rms_slope", "contact_modulus")  # the same at all steps of a load path


def run_all(runs, folder, journal, *, jobs=1, ranks=1, keep=False, timeout=None, description="runs"):
    """Perform runs, several at a time; those that are in the journal with an answer count as done.

    Parameters
    ----------
    runs : sequence of Run
        Equal ones are performed once.
    folder : Path
        Where their files are written.
    journal : Journal
    jobs, ranks : int
        Runs at a time, and ranks of each.
    keep : bool
        Keep the files; runs whose file is missing are performed again.
    timeout : float, optional
        For each run [s].
    description : str
        In front of the progress bar.

    Returns
    -------
    list of dict or None
        Outcome of each run (see `perform`), with the path of its file as `result` if it is kept; None if an
        interrupt (Ctrl-C) left it undone.
    bool
        Whether there was an interrupt.
    """
    keys = [run.key(ranks) for run in runs]
    files = {key: folder / f"{key}.h5" for key in keys}
    todo = {}
    for key, run in zip(keys, runs, strict=True):
        status = journal.outcomes.get(key, {}).get("exit_status")
        if status not in FINISHED or (keep and not files[key].is_file()):
            journal.outcomes.pop(key, None)
            todo[key] = run
    try:
        folder.mkdir(exist_ok=True)
    except OSError as error:
        raise InputError(f"{folder}: needed for the files of the runs: {error.strerror}") from None
    stop, interrupted, failed = Event(), False, 0

    def work(key, run):
        try:
            return perform(run, files[key], stop, ranks, timeout)
        finally:
            if not keep:
                for suffix in (".h5", ".csv"):  # the table of a load path is in that of the sweep
                    files[key].with_suffix(suffix).unlink(missing_ok=True)

    total = len(files)
    bar = tqdm(total=total, initial=total - len(todo), desc=description, unit="run", disable=None)
    with bar, ThreadPoolExecutor(jobs) as pool:
        futures = {pool.submit(work, key, run): key for key, run in todo.items()}
        try:
            for future in as_completed(futures):
                outcome = future.result()
                journal.add(futures[future], outcome)
                failed += outcome["exit_status"] != 0
                bar.set_postfix_str(f"{failed} failed" if failed else "", refresh=False)
                bar.update()
        except BaseException as error:
            pool.shutdown(wait=False, cancel_futures=True)
            stop.set()
            interrupted = isinstance(error, KeyboardInterrupt)
            if not interrupted:
                raise
    if not any(folder.iterdir()):
        folder.rmdir()

    def told(key):
        outcome = journal.outcomes.get(key)
        kept = {"result": str(files[key])} if keep and files[key].is_file() else {}
        return outcome and {**outcome, **kept}

    return [told(key) for key in keys], interrupted


def make_rows(runs, outcomes):
    """Rows of the table: labels and outcome of every run that is done, of a load path one for each step.

    A column of the outcome that has the name of a varied option is called ``result_NAME``. What a load path prescribes
    comes first. What is not known of a step, such as its work, only the row of the last one has.
    """
    taken = {name for run in runs for name in run.labels}
    done = [(run, outcome) for run, outcome in zip(runs, outcomes, strict=True) if outcome is not None]
    paths = {f"{name}_path": name for name in OUTCOME}
    prescribed = {paths[name] for run in runs for name in run.options if name in paths}
    steps = [(run, step) for run, outcome in done for step in _steps_of(outcome)]
    unknown = {*WHERE_KNOWN, "step"}.difference(*(step for _, step in steps))
    names = [name for name in ("exit_status", "step", *OUTCOME, "result") if name not in unknown]
    names = sorted(dict.fromkeys(names), key=lambda name: (name not in names[:2], name not in prescribed))
    columns = {name: f"result_{name}" if name in taken else name for name in names}
    return [
        {**run.labels, **{column: step.get(name) for name, column in columns.items()}} for run, step in steps
    ]


def _steps_of(outcome):
    """Outcomes of the steps of a run; of one without a load path its own."""
    *before, last = outcome.get("steps") or [{}]
    of_run = {
        name: outcome[name] for name in ("exit_status", "message", "result", *_OF_PROBLEM) if name in outcome
    }
    return [*(of_run | step for step in before), outcome | last]
