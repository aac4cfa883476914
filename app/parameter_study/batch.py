"""Simultaneous runs of a parameter study, and the rows of its table."""

from concurrent.futures import ThreadPoolExecutor, as_completed
from threading import Event

from tqdm import tqdm

from app.base.errors import InputError
from app.parameter_study.processes import perform
from app.parameter_study.run import OUTCOME, WHERE_KNOWN

# Exit statuses that --resume keeps. Refusals may depend on memory and packages, and crashes deserve another try.
FINISHED = (0, 3)
_OF_PROBLEM = ("rms_height", "rms_slope", "contact_modulus")  # numbers that all steps of a load path share


def run_all(runs, folder, journal, *, jobs=1, ranks=1, keep=False, timeout=None, description="runs"):
    """Perform the runs that are not finished according to the journal.

    Parameters
    ----------
    runs : sequence of Run
        Runs of the study; equal ones are performed once.
    folder : Path
        Folder of the runs' result files.
    journal : Journal
        Outcomes of earlier runs by key; each new outcome is added.
    jobs, ranks : int
        Number of simultaneous runs, and number of ranks of each run.
    keep : bool
        If true, keep the result files, and repeat finished runs whose files are missing.
    timeout : float, optional
        Longest time of a run [s].
    description : str
        Text before the progress bar.

    Return the outcome of each run (see `perform`), with the path of a kept file as `result`, None for a run that was
    not done because of an interrupt (Ctrl-C); and whether there was one.
    """
    keys = [run.key(ranks) for run in runs]
    files = {key: folder / f"{key}.h5" for key in keys}
    pending = {}
    for key, run in zip(keys, runs, strict=True):
        status = journal.outcomes.get(key, {}).get("exit_status")
        if status not in FINISHED or (keep and not files[key].is_file()):
            journal.outcomes.pop(key, None)
            pending[key] = run
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
                for suffix in (".h5", ".csv"):  # the table of a load path
                    files[key].with_suffix(suffix).unlink(missing_ok=True)

    total = len(files)
    bar = tqdm(total=total, initial=total - len(pending), desc=description, unit="run", disable=None)
    with bar, ThreadPoolExecutor(jobs) as pool:
        futures = {pool.submit(work, key, run): key for key, run in pending.items()}
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
    outcomes = [journal.outcomes.get(key) for key in keys]
    if keep:
        for k, key in enumerate(keys):
            if outcomes[k] and files[key].is_file():
                outcomes[k] = outcomes[k] | {"result": str(files[key])}
    return outcomes, interrupted


def make_rows(runs, outcomes):
    """Return table rows with runs' labels and outcomes.

    A run with a load path has a row for each step. Only the row of the last step has numbers of the whole run, such as
    its work. If NAME is a varied option, a result of the same name has the column ``result_NAME``. Quantities that load
    paths prescribe come first.
    """
    labels = {name for run in runs for name in run.labels}
    finished = [(run, outcome) for run, outcome in zip(runs, outcomes, strict=True) if outcome is not None]
    paths = {f"{name}_path": name for name in OUTCOME}
    prescribed = {paths[name] for run in runs for name in run.options if name in paths}
    steps = []
    for run, outcome in finished:
        *earlier, last = outcome.get("steps") or [{}]
        common = ("exit_status", "message", "result", *_OF_PROBLEM)
        common = {name: outcome[name] for name in common if name in outcome}
        steps += [(run, common | step) for step in earlier] + [(run, outcome | last)]
    unknown = {*WHERE_KNOWN, "step"}.difference(*(step for _, step in steps))
    names = [name for name in ("exit_status", "step", *OUTCOME, "result") if name not in unknown]
    names = sorted(dict.fromkeys(names), key=lambda name: (name not in names[:2], name not in prescribed))
    columns = {name: f"result_{name}" if name in labels else name for name in names}
    numbers = [{column: step.get(name) for name, column in columns.items()} for _, step in steps]
    return [run.labels | row for (run, _), row in zip(steps, numbers, strict=True)]
