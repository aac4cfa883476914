"""Mutants of the numerical core: small changes of its code, each of which a test should notice.

``run/mutate`` calls this; docs/mutation.md tells what came of it. Cosmic-ray makes the mutants. Added here is what
numba asks for: loops that call a changed loop are compiled anew, or they would go on with the old one; and the tests of
a mutant are those that reach its line, as coverage saw, or, for a loop, which it cannot see into, a call of it.
"""

import argparse
import ast
import json
import os
import random
import re
import shutil
import signal
import subprocess
import sys
from collections import Counter
from pathlib import Path

from cosmic_ray.commands.init import _all_work_items
from cosmic_ray.mutating import mutate_code
from cosmic_ray.plugins import get_operator
from coverage import Coverage, CoverageData

CORE = ("halfspace", "multigrid", "contact", "fast", "primal")
# Not those that fail at the first call, as a bitwise operator between floats, and none of a decorator.
KINDS = re.compile(
    r"NumberReplacer|AddNot|Replace(And|Or|True|False)With\w+|Delete_\w+|Break\w+|Continue\w+|ZeroIteration\w+"
    r"|Operator_(Mul_Div|Div_Mul|Add_Sub|Sub_Add|Mod_Add|Pow_Mul|FloorDiv_Mul|BitAnd_BitOr|BitOr_BitAnd|LShift_RShift)$"
    r"|ComparisonOperator_(Is_IsNot|IsNot_Is|(Gt|Lt|GtE|LtE|Eq|NotEq)_(Gt|Lt|GtE|LtE|Eq|NotEq))$"
)


class Function:
    """A compiled loop: its file, name and lines."""

    def __init__(self, path, node):
        self.path, self.name, self.lines = path, node.name, range(node.lineno, node.end_lineno + 1)


class Core:
    """The sources in a folder, which tests reach which lines, and which loops are compiled."""

    def __init__(self, tree, data, log):
        self.tree = tree
        self.paths = [path for part in CORE for path in sorted((tree / "app" / part).rglob("*.py"))]
        self.sources = {path: path.read_text(encoding="utf-8") for path in self.paths}
        self.trees = {path: ast.parse(text) for path, text in self.sources.items()}
        self.loops = [
            Function(path, node)
            for path, module in self.trees.items()
            for node in ast.walk(module)
            if isinstance(node, ast.FunctionDef)
            and any(re.search(r"njit|any_order|intrinsic", ast.unparse(one)) for one in node.decorator_list)
        ]
        self.seconds = Counter()
        text = log.read_text(encoding="utf-8", errors="replace")
        for time, test in re.findall(r"^([\d.]+)s (?:call|setup) +(.+)$", text, re.MULTILINE):
            self.seconds[test] += float(time)
        for test in re.findall(r"^FAILED (.+?)(?: - .*)?$", text, re.MULTILINE):
            del self.seconds[test]
        self.data, self.seen = CoverageData(str(data)), {}
        self.data.read()

    def tests_of_lines(self, path, lines):
        """Tests that run one of these lines."""
        if path not in self.seen:
            self.seen[path] = self.data.contexts_by_lineno(str(path.relative_to(self.tree)))
        return {
            context.rpartition("|")[0]
            for line, contexts in self.seen[path].items()
            if lines is None or line in lines
            for context in contexts
        } & self.seconds.keys()

    def loop_at(self, path, line):
        """The compiled loop that has a line, or None."""
        return next((loop for loop in self.loops if loop.path == path and line in loop.lines), None)

    def callers(self, loop, seen):
        """Names of a loop and of the loops that call it, and the tests of the lines that name one of them."""
        seen.add(loop.name)
        tests = set()
        for path in sorted((self.tree / "app").rglob("*.py")):
            for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1):
                if not re.search(rf"\b{loop.name}\b", line) or line.lstrip().startswith("def "):
                    continue
                caller = self.loop_at(path, number)
                if caller is None:
                    tests |= self.tests_of_lines(path, {number})
                elif caller.name not in seen:
                    tests |= self.callers(caller, seen)
        return tests

    def tests(self, path, line):
        """Tests for a mutant in a line, the quickest first; the loops to compile anew; whether the line is reached."""
        loop, compiled = self.loop_at(path, line), set()
        if loop:
            tests = self.callers(loop, compiled)
        else:
            around = [
                range(node.lineno, node.end_lineno + 1)
                for node in ast.walk(self.trees[path])
                if isinstance(node, ast.stmt) and node.lineno <= line <= node.end_lineno
            ]
            tests = self.tests_of_lines(path, min(around, key=len))
        reached = bool(tests)
        tests = tests or self.tests_of_lines(path, None)
        return sorted(tests, key=lambda test: (self.seconds[test], test)), compiled, reached


def sample(core, seed):
    """Mutants: one of every file, a second one of every file, and so on; a line at random, then one of its mutants."""
    chance, columns = random.Random(seed), []
    for path in core.paths:
        lines = {}
        for item in _all_work_items([path], {}):
            mutation = item.mutations[0]
            decorator = core.sources[path].splitlines()[mutation.start_pos[0] - 1].startswith("@")
            if KINDS.search(mutation.operator_name) and not decorator:
                lines.setdefault(mutation.start_pos[0], []).append(mutation)
        numbers = sorted(lines)
        chance.shuffle(numbers)
        columns.append([chance.choice(lines[number]) for number in numbers])
    for k in range(max(map(len, columns))):
        yield from (column[k] for column in columns if k < len(column))


def judge(core, mutation, folder, python, budget, limit):
    """Put a mutant in the place of its file, run its tests, and take it away again."""
    path, line = Path(mutation.module_path), mutation.start_pos[0]
    text, times = core.sources[path], path.stat()
    changed = mutate_code(text, get_operator(mutation.operator_name)(), mutation.occurrence)
    new = [(a, b) for a, b in zip(text.splitlines(), changed.splitlines(), strict=False) if a != b][:1]
    ordered, loops, reached = core.tests(path, line)
    tests, spent = [], 0.0
    for test in ordered:
        spent += core.seconds[test] + 0.02
        if tests and (spent > budget or len(tests) >= 60):
            break
        tests.append(test)
    result = {
        "file": str(path.relative_to(core.tree)),
        "line": line,
        "operator": mutation.operator_name.removeprefix("core/"),
        "old": new[0][0].strip() if new else "",
        "new": new[0][1].strip() if new else "",
        "loop": bool(loops),
        "reached": reached,
        "tests": len(tests),
        "of": len(ordered),
    }
    if not tests:
        return result | {"verdict": "no test"}
    cache = folder / "numba"
    if loops:
        cache = folder / "numba-mutant"
        shutil.rmtree(cache, ignore_errors=True)
        shutil.copytree(folder / "numba", cache)
        for name in loops:
            for file in cache.rglob(f"*.{name}-*"):
                file.unlink()
    environment = os.environ | {"NUMBA_CACHE_DIR": str(cache), "PYTHONDONTWRITEBYTECODE": "1"}
    command = [python, "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider", "--tb=line", *tests]
    path.write_text(changed, encoding="utf-8")
    try:
        run = subprocess.Popen(
            command,
            cwd=core.tree,
            env=environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            start_new_session=True,
        )
        try:
            said = run.communicate(timeout=limit)[0]
            if "while loading conftest" in said:  # that is no mutant's doing: all would count as killed
                raise RuntimeError(said)
            verdict = "survived" if run.returncode == 0 else "killed"
            result["said"] = next((one for one in said.splitlines() if one.startswith("FAILED")), said[-300:])
        except subprocess.TimeoutExpired:
            os.killpg(run.pid, signal.SIGKILL)
            run.communicate()
            verdict = "timeout"
    finally:
        path.write_text(text, encoding="utf-8")
        os.utime(path, ns=(times.st_atime_ns, times.st_mtime_ns))  # numba and Python go by it
    return result | {"verdict": verdict}


def table(core, data, results):
    """Rows of docs/mutation.md: statements, those that tests run, those in loops; mutants, and what became of them."""
    coverage = Coverage(data_file=str(data), config_file=str(core.tree / "pyproject.toml"))
    coverage.load()
    for part in CORE:
        statements = missed = compiled = 0
        for path in core.paths:
            if path.parts[len(core.tree.parts) + 1] == part:
                _, seen, excluded, missing, _ = coverage.analysis2(str(path))
                statements, missed, compiled = (
                    statements + len(seen),
                    missed + len(missing),
                    compiled + len(excluded),
                )
        verdicts = Counter(one["verdict"] for one in results if one["file"].split("/")[1] == part)
        yield (
            f"| `{part}` | {statements} | {1 - missed / statements:.0%} | {compiled} | {verdicts.total()} "
            f"| {verdicts['killed']} | {verdicts['timeout']} | {verdicts['survived'] + verdicts['no test']} |"
        )


def main():
    """Judge the first mutants of the sample; those judged before are kept."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "folder", type=Path, help="with tree/, numba/, cov.* and *.log, as run/mutate makes it"
    )
    parser.add_argument("--python", default=sys.executable)
    parser.add_argument("--mutants", type=int, default=110)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--budget", type=float, default=20, help="seconds that the tests of a mutant take")
    parser.add_argument("--limit", type=float, default=120, help="seconds until a mutant counts as endless")
    chosen = parser.parse_args()
    folder = chosen.folder.resolve()
    core = Core(folder / "tree", folder / "cov.unit", folder / "unit.log")
    judged = folder / "mutants.jsonl"
    done = len(judged.read_text().splitlines()) if judged.exists() else 0
    for number, mutation in enumerate(sample(core, chosen.seed)):
        if number >= chosen.mutants:
            break
        if number < done:
            continue
        result = judge(core, mutation, folder, chosen.python, chosen.budget, chosen.limit)
        with judged.open("a") as file:
            file.write(json.dumps(result) + "\n")
        print(number, *(result[key] for key in ("verdict", "file", "line", "old", "new")), flush=True)
    os.chdir(core.tree)  # names of files in the data are relative
    results = [json.loads(line) for line in judged.read_text().splitlines()]
    print(*table(core, folder / "cov", results), sep="\n")


if __name__ == "__main__":
    main()
