#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""Changes one token of a source file of core at a time and counts how many of these mutants the tests detect.

mutants.py FIRST LAST MINUTES   (MINUTES 0: no limit)

Mutant N is a random change that compiles, and depends on N and the committed sources alone. Each worker has a copy of the sources
and a build of its own below build/mutants. core_tests runs for all mutants first; then sim_tests, and tools_tests for the folders
that it tests, run for those that survive. Of each program, the tests in files named like the changed file or its folder run first,
then the quick ones. build/mutants/results.jsonl keeps the results, so that a later run continues. Prints a JSON object on standard
output and progress on standard error: mutants that were not tried with all programs count as undetected. Exits with 2 if the
unchanged sources do not build or pass their tests.
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
BUILD_SECONDS = 7200
QUICK_SECONDS = 1.0  # a test that takes no longer runs before the others
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


def programs_for(name):
    return [program for program in PROGRAMS if program != "tools_tests" or pathlib.Path(name).parent.name in TESTED_BY_TOOLS]


def nearest_suites(name, program):
    """Returns the names of the test suites in files that are named like the source file or its folder."""
    path, suites = pathlib.Path(name), set()
    for stem in (path.stem, path.parent.name):
        test = ROOT / "tests" / program.removesuffix("_tests") / f"{stem}_test.cpp"
        if test.exists():
            suites |= set(re.findall(r"^TEST(?:_F|_P)?\((\w+),", test.read_text(encoding="utf-8"), re.M))
    return suites


def stages(name, program, durations):
    """Returns (filter, seconds that its tests take) of the tests near to a source file, of all quick ones, and of the others."""
    suites = nearest_suites(name, program)
    nearest = [test for test in durations if suites & set(test.partition(".")[0].split("/"))]  # INSTANTIATION/SUITE
    slow = sorted((test for test in durations if durations[test] > QUICK_SECONDS), key=durations.get)
    quick = [test for test in durations if durations[test] <= QUICK_SECONDS]
    found = [(nearest, ":".join(sorted(nearest))), (quick, "-" + ":".join(slow)), (slow, ":".join(slow))]
    return [(text, sum(durations[test] for test in tests)) for tests, text in found if tests]


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
                  "-DFRINGESLAM_UNITY=OFF", "-DFRINGESLAM_BENCH=OFF", "-DFRINGESLAM_PYTHON=OFF", "-DFRINGESLAM_REPORT=OFF"], BUILD_SECONDS)  # fmt: skip

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

    def builds(self, program):
        return self.run(["ninja", "-C", self.build, "-j1", program], BUILD_SECONDS) == 0

    def executable(self, program):
        return self.build / "tests" / program.removesuffix("_tests") / program

    def durations(self, program):
        """Builds and runs a test program of the unchanged sources; returns the seconds that each test takes."""
        if not self.builds(program):
            sys.exit(f"mutants: {self.folder / 'log'}: {program} of the unchanged sources does not build")
        report = self.folder / "tests.json"
        report.unlink(missing_ok=True)
        if self.run([self.executable(program), f"--gtest_output=json:{report}"], BUILD_SECONDS) != 0:
            sys.exit(f"mutants: {self.folder / 'log'}: {program} of the unchanged sources fails")
        suites = json.loads(report.read_text(encoding="utf-8"))["testsuites"]
        tests = [(f"{suite['name']}.{test['name']}", test["time"]) for suite in suites for test in suite["testsuite"]]
        return {name: float(seconds.removesuffix("s")) for name, seconds in tests}

    def detected_by(self, name, program, durations):
        """Returns what detects the change: the test program, "timeout", or an empty text."""
        for tests, seconds in stages(name, program, durations):
            command = [self.executable(program), "--gtest_brief=1", f"--gtest_filter={tests}"]
            code = self.run(command, 60 + 5 * seconds, GTEST_FAIL_FAST="1")  # an endless loop counts as detected
            if code != 0:
                return "timeout" if code is None else program
        return ""

    def judge(self, mutant, files, program, durations):
        """Returns the mutant with what detects it, or None if it does not compile."""
        name, first, to = mutant["file"], mutant["first"], mutant["to"]
        text, path = files[name], self.source / name
        path.write_text(text[:first] + to + text[first + len(mutant["from"]) :], encoding="utf-8")
        try:
            if not self.builds(program):
                return None
            by = self.detected_by(name, program, durations)
        finally:
            path.write_text(text, encoding="utf-8")
        return {**mutant, "detected_by": by, "tried": mutant["tried"] + [program]}


def drawn(number, files, candidates):
    """Yields the changes that mutant `number` may be: the first one that compiles is the mutant."""
    draw = random.Random(number)
    for _ in range(MOST_DRAWS):
        name, first, _, token = draw.choice(candidates)
        line = files[name].count("\n", 0, first) + 1
        yield {"mutant": number, "file": name, "line": line, "first": first, "from": token, "to": replacement(token), "tried": [],
               "text": files[name].splitlines()[line - 1].strip()}  # fmt: skip


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
    lock, count = threading.Lock(), os.cpu_count() or 1
    print(f"  {len(candidates)} tokens in {len(files)} files; building", file=sys.stderr, flush=True)
    workers = [Worker(index, commit) for index in range(count)]

    def work(worker, program, durations, waiting):
        while time.monotonic() < end:
            try:
                number = waiting.get_nowait()
            except queue.Empty:
                return
            choices = [results[number]] if number in results else drawn(number, files, candidates)
            result = next(filter(None, (worker.judge(choice, files, program, durations) for choice in choices)), None)
            if not result:
                sys.exit(f"mutants: {worker.folder / 'log'}: {program} of mutant {number} does not build")
            with lock, RESULTS.open("a", encoding="utf-8") as log:
                log.write(json.dumps({**result, "commit": commit}) + "\n")
                results[number] = result
                print(f"  {number}: {result['file']}:{result['line']}: {result['from']} -> {result['to'] or 'nothing'}: "
                      f"{result['detected_by'] or 'survives ' + program}", file=sys.stderr, flush=True)  # fmt: skip

    def needs(number, program):
        if number not in results:
            return program == PROGRAMS[0]
        result = results[number]
        return not result["detected_by"] and program not in result["tried"] and program in programs_for(result["file"])

    for program in PROGRAMS:
        waiting = queue.SimpleQueue()
        for number in range(first, last + 1):
            if needs(number, program):
                waiting.put(number)
        if waiting.empty() or time.monotonic() > end:
            continue
        with concurrent.futures.ThreadPoolExecutor(count) as pool:
            # The first build fills the compiler cache for the others.
            durations = workers[0].durations(program)
            for built in [pool.submit(worker.builds, program) for worker in workers[1:]]:
                if not built.result():
                    sys.exit(f"mutants: {program} of the unchanged sources does not build")
            for done in [pool.submit(work, worker, program, durations, waiting) for worker in workers]:
                done.result()
    chosen = [result for number, result in sorted(results.items()) if first <= number <= last]
    undecided = sum(any(needs(result["mutant"], program) for program in PROGRAMS) for result in chosen)
    if undecided:
        print(f"  {undecided} survivors were not tried with all programs", file=sys.stderr, flush=True)
    print(json.dumps({"mutants": len(chosen), "detected": sum(bool(result["detected_by"]) for result in chosen)}))


if __name__ == "__main__":
    if len(sys.argv) != 4:
        sys.exit(__doc__)
    try:
        main(int(sys.argv[1]), int(sys.argv[2]), float(sys.argv[3]))
    except SystemExit as problem:
        print(problem.code, file=sys.stderr)
        sys.exit(2)
