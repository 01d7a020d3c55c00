#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""Changes one token of a source file of core at a time and counts how many of these mutants the tests detect.

mutants.py FIRST LAST MINUTES   (MINUTES 0: no limit)

Mutant N is a random change that compiles, and depends on N and the committed sources alone. Each worker has a copy of the sources
and a build of its own below build/mutants. First those tests run whose file has the name of the changed file or of its folder, then
all of core_tests and sim_tests, and tools_tests for the folders that it tests. build/mutants/results.jsonl keeps the results, so
that a later run continues. Prints a JSON object on standard output and progress on standard error; exits with 2 if the unchanged
sources do not build or pass their tests.
"""
import concurrent.futures
import json
import os
import pathlib
import queue
import random
import re
import shutil
import signal
import subprocess
import sys
import threading
import time

ROOT = pathlib.Path(__file__).resolve().parents[2]
WORK = ROOT / "build" / "mutants"
RESULTS = WORK / "results.jsonl"
PROGRAMS = ("core_tests", "sim_tests", "tools_tests")
TESTED_BY_TOOLS = {"check", "import", "io", "rig", "score", "storage"}  # folders of core; the program's tests run for minutes
MOST_SECONDS = 1200  # of one test program: an endless loop counts as detected
MOST_DRAWS = 50

# Comments, strings, characters and preprocessor lines are skipped. Binary operators stand between spaces (clang-format), unlike
# the brackets of templates.
TOKENS = re.compile(
    r"""(?P<skip>//[^\n]*|/\*.*?\*/|R"\((?:.|\n)*?\)"|"(?:\\.|[^"\\\n])*"|(?<!\w)'(?:\\.|[^'\\\n])+'|^[ \t]*\#(?:\\\n|[^\n])*)"""
    r"""|(?P<operator>(?<=\ )(?:<=|>=|==|!=|&&|\|\||\+=|-=|\*=|/=|[<>+*/-])(?=\s))"""
    r"""|(?P<step>\+\+|--)"""
    r"""|(?P<not>!(?=[\w(]))"""
    r"""|(?P<word>\b(?:true|false|std::min|std::max|break|continue)\b)"""
    r"""|(?P<number>(?<![\w.])\d+\.?\d*(?:e[+-]?\d+)?f?(?![\w.']))""",
    re.S | re.M | re.X,
)
REPLACEMENTS = {
    "<": "<=", "<=": "<", ">": ">=", ">=": ">", "==": "!=", "!=": "==", "&&": "||", "||": "&&", "+": "-", "-": "+",
    "*": "/", "/": "*", "+=": "-=", "-=": "+=", "*=": "/=", "/=": "*=", "++": "--", "--": "++", "true": "false",
    "false": "true", "std::min": "std::max", "std::max": "std::min", "break": "continue", "continue": "break", "!": "",
}  # fmt: skip


def replacement(token):
    if token in REPLACEMENTS:
        return REPLACEMENTS[token]
    if token.isdigit():
        return str(int(token) + 1)
    suffix = "f" if token.endswith("f") else ""
    value = float(token.removesuffix("f"))
    return repr(2 * value if value else 1.0) + suffix


def places(files):
    """Returns (file, first, last, token) of all tokens that can be changed."""
    found = []
    for name, text in files.items():
        for match in TOKENS.finditer(text):
            if match.lastgroup != "skip":
                found.append((name, match.start(), match.end(), match.group()))
    return found


def nearest_tests(name):
    """Returns (program, filter) of the tests in files named like the source file or its folder."""
    path, found = pathlib.Path(name), []
    for program in PROGRAMS:
        suites = set()
        for stem in (path.stem, path.parent.name):
            test = ROOT / "tests" / program.removesuffix("_tests") / f"{stem}_test.cpp"
            if test.exists():
                suites |= set(re.findall(r"^(?:TEST|TEST_F)\((\w+),", test.read_text(encoding="utf-8"), re.M))
        if suites:
            found.append((program, ":".join(f"{suite}.*" for suite in sorted(suites))))
    return found


class Worker:
    def __init__(self, number, commit):
        self.folder = WORK / f"worker{number}"
        self.source, self.build = self.folder / "source", self.folder / "build"
        shutil.rmtree(self.source, ignore_errors=True)
        self.source.mkdir(parents=True)
        archive = subprocess.run(["git", "-C", ROOT, "archive", commit], check=True, stdout=subprocess.PIPE).stdout
        # Files get the present time, because an interrupted run may have left the object file of a mutant. The compiler cache keeps
        # this cheap.
        subprocess.run(["tar", "-x", "-m", "-C", self.source], check=True, input=archive)
        (self.folder / "tmp").mkdir(exist_ok=True)
        self.run(["cmake", "-S", self.source, "-B", self.build, "-G", "Ninja", "-DCMAKE_BUILD_TYPE=Release",
                  "-DFRINGESLAM_UNITY=OFF", "-DFRINGESLAM_BENCH=OFF", "-DFRINGESLAM_PYTHON=OFF", "-DFRINGESLAM_REPORT=OFF"], MOST_SECONDS)  # fmt: skip
        if not self.compiles():
            sys.exit(f"mutants: {self.build}: the unchanged sources do not build")

    def run(self, command, seconds, **environment):
        """Returns the exit code, or None after `seconds`; ends all processes of the command."""
        env = {**os.environ, "TMPDIR": str(self.folder / "tmp"), **environment}
        log = (self.folder / "log").open("w", encoding="utf-8")
        process = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=log, stderr=log, env=env, start_new_session=True)
        try:
            return process.wait(seconds)
        except subprocess.TimeoutExpired:
            return None
        finally:
            try:
                os.killpg(process.pid, signal.SIGKILL)
            except ProcessLookupError:
                pass
            process.wait()

    def compiles(self):
        return self.run(["ninja", "-C", self.build, "-j1", *PROGRAMS], 3600) == 0

    def detected_by(self, name):
        """Returns what detects the change: a test program, "timeout", or an empty text."""
        everything = [(program, "*") for program in PROGRAMS]
        if name and pathlib.Path(name).parent.name not in TESTED_BY_TOOLS:
            everything.pop()
        for program, tests in nearest_tests(name) + everything:
            command = [self.build / "tests" / program.removesuffix("_tests") / program, "--gtest_brief=1", f"--gtest_filter={tests}"]
            code = self.run(command, MOST_SECONDS, GTEST_FAIL_FAST="1")
            if code != 0:
                return "timeout" if code is None else program
        return ""

    def judge(self, number, files, candidates):
        draw = random.Random(number)
        for _ in range(MOST_DRAWS):
            name, first, last, token = draw.choice(candidates)
            text, changed = files[name], replacement(token)
            path = self.source / name
            path.write_text(text[:first] + changed + text[last:], encoding="utf-8")
            try:
                if not self.compiles():
                    continue
                by = self.detected_by(name)
            finally:
                path.write_text(text, encoding="utf-8")
            line = text.count("\n", 0, first) + 1
            return {"mutant": number, "file": name, "line": line, "from": token, "to": changed, "detected_by": by,
                    "text": text.splitlines()[line - 1].strip()}  # fmt: skip
        sys.exit(f"mutants: mutant {number}: none of {MOST_DRAWS} changes compiles")


def earlier_results(commit):
    if not RESULTS.exists():
        return {}
    lines = [json.loads(line) for line in RESULTS.read_text(encoding="utf-8").splitlines()]
    return {result["mutant"]: result for result in lines if result["commit"] == commit}


def main(first, last, minutes):
    end = time.monotonic() + 60 * minutes if minutes else float("inf")
    commit = subprocess.run(["git", "-C", ROOT, "rev-parse", "HEAD"], check=True, text=True, stdout=subprocess.PIPE).stdout.strip()
    names = subprocess.run(["git", "-C", ROOT, "ls-files", "core/*.cpp"], check=True, text=True, stdout=subprocess.PIPE).stdout
    files = {name: (ROOT / name).read_text(encoding="utf-8") for name in names.split()}
    candidates = places(files)
    WORK.mkdir(parents=True, exist_ok=True)
    results = earlier_results(commit)
    waiting, lock, workers = queue.SimpleQueue(), threading.Lock(), os.cpu_count() or 1
    for number in range(first, last + 1):
        if number not in results:
            waiting.put(number)
    print(f"  {len(candidates)} tokens in {len(files)} files; building", file=sys.stderr, flush=True)

    def work(index):
        worker = Worker(index, commit)
        if index == 0 and worker.detected_by(""):
            sys.exit(f"mutants: the unchanged sources fail their tests; see {worker.folder / 'log'}")
        while time.monotonic() < end:
            try:
                number = waiting.get_nowait()
            except queue.Empty:
                return
            result = {"commit": commit, **worker.judge(number, files, candidates)}
            with lock, RESULTS.open("a", encoding="utf-8") as log:
                log.write(json.dumps(result) + "\n")
                results[number] = result
                print(f"  {number}: {result['file']}:{result['line']}: {result['from']} -> {result['to'] or 'nothing'}: "
                      f"{result['detected_by'] or 'SURVIVES'}", file=sys.stderr, flush=True)  # fmt: skip

    with concurrent.futures.ThreadPoolExecutor(workers) as pool:
        for done in [pool.submit(work, index) for index in range(workers)]:
            done.result()
    chosen = [result for number, result in sorted(results.items()) if first <= number <= last]
    print(json.dumps({"mutants": len(chosen), "detected": sum(bool(result["detected_by"]) for result in chosen)}))


if __name__ == "__main__":
    if len(sys.argv) != 4:
        sys.exit(__doc__)
    try:
        main(int(sys.argv[1]), int(sys.argv[2]), float(sys.argv[3]))
    except SystemExit as problem:
        print(problem.code, file=sys.stderr)
        sys.exit(2)
