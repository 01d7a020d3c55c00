#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""Writes the bills of materials of the Debian packages, which cpack calls:

sbom.py --version V --build FOLDER [--npm package-lock.json] PACKAGE=STAGE...

STAGE is the folder that becomes PACKAGE. STAGE/usr/share/doc/PACKAGE/PACKAGE.spdx.json (SPDX 2.3) lists the files of
the package; the Debian packages whose shared libraries they need directly; those whose static libraries and headers
are compiled into them (according to ninja's records in the build folder); and the npm packages bundled into the web
pages. The same source, tools and installed packages give the same bytes; SOURCE_DATE_EPOCH is the date of creation.
"""
import argparse
import base64
import collections
import datetime
import functools
import hashlib
import json
import os
import pathlib
import re
import subprocess
import sys
from urllib.parse import quote

# Short names of Debian's machine-readable copyright files, in lower case, and what SPDX calls them.
LICENSES = {
    "0bsd": "0BSD", "apache-2": "Apache-2.0", "apache-2.0": "Apache-2.0", "artistic": "Artistic-1.0-Perl",
    "artistic-2.0": "Artistic-2.0", "boost-1.0": "BSL-1.0", "bsd-2-clause": "BSD-2-Clause",
    "bsd-3-clause": "BSD-3-Clause", "bsl-1": "BSL-1.0", "bsl-1.0": "BSL-1.0", "cc0-1.0": "CC0-1.0", "expat": "MIT",
    "isc": "ISC", "mit": "MIT", "mpl-2": "MPL-2.0", "mpl-2.0": "MPL-2.0", "unlicense": "Unlicense", "x11": "X11",
    "zlib": "Zlib", "zlib/libpng": "Zlib",
}
for _name, _versions in {"gpl": ("1", "2", "3"), "lgpl": ("2", "2.1", "3"), "agpl": ("3",), "gfdl": ("1.2", "1.3")}.items():
    for _version in _versions:
        _full = _version if "." in _version else _version + ".0"
        for _spelling in {_version, _full}:
            LICENSES[f"{_name}-{_spelling}"] = f"{_name.upper()}-{_full}-only"
            LICENSES[f"{_name}-{_spelling}+"] = f"{_name.upper()}-{_full}-or-later"

Copyright = collections.namedtuple("Copyright", "expression holders others extracted")
Copyright.__doc__ = "License expression, copyright holders, further license names, {LicenseRef: (name, text)}."


def run(*command, check=True):
    done = subprocess.run(command, capture_output=True, text=True, env=dict(os.environ, LC_ALL="C.UTF-8"))
    if check and done.returncode != 0:
        sys.exit(f"sbom.py: {' '.join(command[:3])}: {done.stderr.strip()}")
    return done.stdout


# ---- Debian's copyright files


def paragraphs(text):
    """Returns the paragraphs of a Debian control file: lists of (field, lines)."""
    found, fields = [], []
    for line in text.splitlines() + [""]:
        if line.startswith("#"):
            continue
        if not line.strip():
            if fields:
                found.append({name.lower(): lines for name, lines in fields})
            fields = []
        elif line[0] in " \t":
            if fields:
                fields[-1][1].append(line.strip())
        elif ":" in line:
            name, value = line.split(":", 1)
            fields.append((name, [value.strip()]))
    return found


def license_expression(synopsis, reference):
    """Translates a license synopsis, such as `GPL-2+ or Expat, and zlib`; calls reference(name) for a name that SPDX
    does not have. In Debian's syntax `, and` and `, or` bind weaker than `and` and `or`."""

    def one(name):
        return LICENSES.get(name.lower()) or reference(name)

    def split(text, separators):
        for separator, operator in separators:
            parts = [part.strip() for part in re.split(separator, text, flags=re.I) if part.strip()]
            if len(parts) > 1:
                translated = [split(part, separators) for part in parts]
                return operator.join(f"({part})" if " " in part else part for part in translated)
        return one(text.strip())

    return split(synopsis, [(r",\s*and\s+", " AND "), (r",\s*or\s+", " OR "), (r"\s+or\s+", " OR "), (r"\s+and\s+", " AND ")])


def read_copyright(package, text):
    """Returns the license of `Files: *`, or None if the file is not machine-readable or has no such paragraph."""
    if not text.lstrip().lower().startswith("format:"):
        return None
    stanzas = paragraphs(text)
    general = next((p for p in stanzas if p.get("files", [""])[0].split()[:1] == ["*"] and "license" in p), None)
    if general is None:
        return None
    texts = {p["license"][0].lower(): "\n".join("" if line == "." else line for line in p["license"][1:]).strip()
             for p in stanzas if "license" in p and len(p["license"]) > 1 and (p is general or "files" not in p)}
    extracted = {}

    def reference(name):
        identifier = f"LicenseRef-{identifier_of(package)}-{identifier_of(name)}"
        extracted[identifier] = (name, texts.get(name.lower()) or f"See /usr/share/doc/{package}/copyright.")
        return identifier

    expression = license_expression(general["license"][0], reference)
    names = {p["license"][0] for p in stanzas if "license" in p and p["license"][0]}
    holders = "\n".join(line for line in general.get("copyright", []) if line and line != ".")
    return Copyright(expression, holders or "NOASSERTION", sorted(names - {general["license"][0]}), extracted)


# ---- What is installed


known_owners = {}  # by path; None: no package


def owners(paths):
    """Returns the Debian package of each path, where there is one. dpkg may know a path with or without /usr."""
    spellings = {}
    for path in set(paths) - set(known_owners):
        known_owners[path] = None
        other = path[4:] if path.startswith("/usr/") else "/usr" + path
        spellings[path], spellings[other] = path, path
    names = sorted(spellings)
    for begin in range(0, len(names), 2000):
        for line in run("dpkg-query", "-S", *names[begin:begin + 2000], check=False).splitlines():
            packages, _, path = line.partition(": ")
            if path in spellings and not packages.startswith("diversion "):
                known_owners[spellings[path]] = packages.split(",")[0].split(":")[0]
    return {path: known_owners[path] for path in paths if known_owners[path]}


@functools.cache
def installed():
    """Returns version, architecture, source package and homepage of each installed package, by name."""
    form = "${binary:Package}\t${Version}\t${Architecture}\t${source:Package}\t${Homepage}\n"
    lines = [line.split("\t") for line in run("dpkg-query", "-W", "-f", form).splitlines()]
    native = run("dpkg", "--print-architecture").strip()
    return {name.split(":")[0]: fields for name, *fields in lines if fields[1] in (native, "all")}


@functools.cache
def cached_libraries():
    """Returns the path of each shared library in the loader's cache, by soname."""
    found = {}
    for line in run("/sbin/ldconfig", "-p").splitlines():
        match = re.match(r"\t(\S+) \(libc6,x86-64.*\) => (\S+)|\t(\S+) \(libc6(?:,[A-Za-z0-9]+)*\) => (\S+)", line)
        if match:
            name, path = [group for group in match.groups() if group]
            found.setdefault(name, path)
    return found


@functools.cache
def package_of_library(soname):
    """Returns the Debian package that provides a shared library. Where update-alternatives chooses among several,
    such as for liblapack.so.3, it is the first that the chosen package's shlibs file names, as in its dependencies."""
    path = cached_libraries().get(soname)
    if path is None:
        sys.exit(f"sbom.py: {soname} is not an installed library")
    package = owners([path]).get(path)
    if package is not None:
        return package
    real = os.path.realpath(path)
    chosen = owners([real]).get(real)
    if chosen is None:
        sys.exit(f"sbom.py: {path} belongs to no package")
    match = re.match(r"(.+)\.so\.(.+)$", soname)
    for line in run("dpkg-query", "--control-show", chosen, "shlibs", check=False).splitlines():
        words = line.split()
        if match and words[:2] == list(match.groups()):
            first = words[2]
            return first if first in installed() else chosen
    return chosen


def is_elf(path):
    with open(path, "rb") as file:
        return file.read(4) == b"\x7fELF"


@functools.cache
def needed(path):
    """Returns the sonames that an ELF file needs directly, and its own or None."""
    dynamic = run("readelf", "--dynamic", "--wide", str(path))
    own = re.search(r"\(SONAME\).*\[(.+)\]", dynamic)
    return re.findall(r"\(NEEDED\).*\[(.+)\]", dynamic), own and own[1]


# ---- What was compiled in


@functools.cache
def compiled_in(build, target):
    """Returns the static libraries outside of the build, and the object files and precompiled headers of the build, that
    one of ninja's targets and the libraries that it links are made of."""
    inputs = set(run("ninja", "-C", str(build), "-t", "inputs", target).splitlines()[1:])
    return {p for p in inputs if p.startswith("/") and p.endswith(".a")}, {p for p in inputs if p.endswith((".o", ".gch"))}


def headers_of(build, objects):
    headers = set()
    objects = sorted(objects)
    for begin in range(0, len(objects), 200):
        for line in run("ninja", "-C", str(build), "-t", "deps", *objects[begin:begin + 200], check=False).splitlines():
            if line.startswith("    /usr/"):
                headers.add(os.path.normpath(line.strip()))
    return headers


# ---- SPDX


quoted = functools.partial(quote, safe="")  # for package URLs


def identifier_of(name):
    return re.sub(r"[^A-Za-z0-9.-]", "-", name)


class Document:
    def __init__(self, package, version, created):
        self.name = package
        self.own = f"SPDXRef-Package-{identifier_of(package)}"
        self.version, self.created = version, created
        self.packages, self.files, self.extracted = {}, [], {}
        self.relations = set()

    def relate(self, element, relation, other):
        self.relations.add((element, relation, other))

    def add_own(self, stage):
        """The package itself and its files; the bill of materials is the one file that it cannot contain."""
        excluded = f"usr/share/doc/{self.name}/{self.name}.spdx.json"
        sums = []
        for path in sorted(p for p in stage.rglob("*") if p.is_file() and not p.is_symlink()):
            name = path.relative_to(stage).as_posix()
            if name == excluded:
                continue
            data = path.read_bytes()
            sums.append(hashlib.sha1(data).hexdigest())
            identifier = f"SPDXRef-File-{hashlib.sha1(name.encode()).hexdigest()[:16]}"
            self.files.append({
                "SPDXID": identifier, "fileName": "./" + name,
                "checksums": [{"algorithm": "SHA1", "checksumValue": sums[-1]},
                              {"algorithm": "SHA256", "checksumValue": hashlib.sha256(data).hexdigest()}],
                "licenseConcluded": "NOASSERTION", "copyrightText": "NOASSERTION"})
            self.relate(self.own, "CONTAINS", identifier)
        self.packages[self.own] = {
            "SPDXID": self.own, "name": self.name, "versionInfo": self.version,
            "supplier": "Organization: FringeSLAM", "downloadLocation": "NOASSERTION", "filesAnalyzed": True,
            "packageVerificationCode": {
                "packageVerificationCodeValue": hashlib.sha1("".join(sorted(sums)).encode()).hexdigest(),
                "packageVerificationCodeExcludedFiles": ["./" + excluded]},
            "licenseConcluded": "NOASSERTION", "licenseDeclared": "Apache-2.0",
            "licenseInfoFromFiles": ["NOASSERTION"], "copyrightText": "The FringeSLAM developers"}
        self.relate("SPDXRef-DOCUMENT", "DESCRIBES", self.own)

    def add_sibling(self, package):
        """Another package of this source."""
        identifier = f"SPDXRef-Package-{identifier_of(package)}"
        self.packages[identifier] = {
            "SPDXID": identifier, "name": package, "versionInfo": self.version,
            "supplier": "Organization: FringeSLAM", "downloadLocation": "NOASSERTION", "filesAnalyzed": False,
            "licenseConcluded": "NOASSERTION", "licenseDeclared": "Apache-2.0",
            "copyrightText": "The FringeSLAM developers"}
        return identifier

    def add_debian(self, package):
        identifier = f"SPDXRef-Package-deb-{identifier_of(package)}"
        if identifier in self.packages:
            return identifier
        version, architecture, source, homepage = installed()[package]
        entry = {
            "SPDXID": identifier, "name": package, "versionInfo": version, "supplier": "Organization: Debian",
            "downloadLocation": "NOASSERTION", "filesAnalyzed": False, "licenseConcluded": "NOASSERTION",
            "licenseDeclared": "NOASSERTION", "copyrightText": "NOASSERTION",
            "externalRefs": [{
                "referenceCategory": "PACKAGE-MANAGER", "referenceType": "purl",
                "referenceLocator": f"pkg:deb/debian/{quoted(package)}@{quoted(version)}"
                                    f"?arch={architecture}&distro=debian-12&upstream={quoted(source)}"}]}
        if homepage:
            entry["homepage"] = homepage
        file = pathlib.Path(f"/usr/share/doc/{package}/copyright")
        legal = read_copyright(package, file.read_text(errors="replace")) if file.exists() else None
        if legal is None:
            entry["licenseComments"] = f"Not machine-readable: see {file}."
        else:
            entry["licenseDeclared"], entry["copyrightText"] = legal.expression, legal.holders
            if legal.others:
                entry["licenseComments"] = f"Parts of the source package have other licenses: {'; '.join(legal.others)}."
            self.extracted.update(legal.extracted)
        self.packages[identifier] = entry
        return identifier

    def add_npm(self, name, locked):
        identifier = f"SPDXRef-Package-npm-{identifier_of(name)}"
        algorithm, _, digest = locked["integrity"].partition("-")
        self.packages[identifier] = {
            "SPDXID": identifier, "name": name, "versionInfo": locked["version"], "supplier": "NOASSERTION",
            "downloadLocation": locked.get("resolved")
                or f"https://registry.npmjs.org/{name}/-/{name.split('/')[-1]}-{locked['version']}.tgz",
            "filesAnalyzed": False,
            "checksums": [{"algorithm": algorithm.upper(), "checksumValue": base64.b64decode(digest).hex()}],
            "licenseConcluded": "NOASSERTION", "licenseDeclared": locked.get("license", "NOASSERTION"),
            "copyrightText": "NOASSERTION",
            "externalRefs": [{"referenceCategory": "PACKAGE-MANAGER", "referenceType": "purl",
                              "referenceLocator": f"pkg:npm/{quote(name, safe='/')}@{quoted(locked['version'])}"}]}
        return identifier

    def text(self):
        document = {
            "spdxVersion": "SPDX-2.3", "dataLicense": "CC0-1.0", "SPDXID": "SPDXRef-DOCUMENT",
            "name": f"{self.name}-{self.version}", "documentNamespace": "",
            "creationInfo": {"created": self.created, "creators": ["Organization: FringeSLAM", "Tool: sbom.py"]},
            "packages": [self.packages[key] for key in sorted(self.packages)],
            "files": self.files,
            "hasExtractedLicensingInfos": [
                {"licenseId": key, "name": name, "extractedText": text}
                for key, (name, text) in sorted(self.extracted.items())],
            "relationships": [
                {"spdxElementId": element, "relationshipType": relation, "relatedSpdxElement": other}
                for element, relation, other in sorted(self.relations)]}
        # Different contents need different namespaces.
        digest = hashlib.sha256(json.dumps(document, sort_keys=True).encode()).hexdigest()
        document["documentNamespace"] = f"https://fringeslam.example.org/spdx/{self.name}-{self.version}-{digest[:32]}"
        return json.dumps(document, indent=1, ensure_ascii=False) + "\n"


@functools.cache
def build_targets(build):
    """Returns the ninja target of each file name that the build links."""
    found = {}
    for line in run("ninja", "-C", str(build), "-t", "targets", "all").splitlines():
        target, _, rule = line.rpartition(": ")
        if re.match(r"CXX_(EXECUTABLE|SHARED_LIBRARY|MODULE_LIBRARY)_LINKER__", rule):
            found[os.path.basename(target)] = target
    return found


def describe(package, stages, elves, providers, arguments):
    """Returns the document of one package. elves: {package: [paths]}; providers: {soname: package}."""
    stage = stages[package]
    document = Document(package, arguments.version, created_time())
    document.add_own(stage)
    identifiers = {file["fileName"][2:]: file["SPDXID"] for file in document.files}
    for path in elves[package]:
        for soname in needed(path)[0]:
            provider = providers.get(soname)
            if provider == package:
                continue
            other = document.add_sibling(provider) if provider else document.add_debian(package_of_library(soname))
            document.relate(identifiers[path.relative_to(stage).as_posix()], "DYNAMIC_LINK", other)
            document.relate(document.own, "DEPENDS_ON", other)

    targets = build_targets(arguments.build) if (arguments.build / "build.ninja").exists() else {}
    missing = sorted(path.name for path in elves[package] if path.name not in targets)
    if targets and missing:
        sys.exit(f"sbom.py: {arguments.build} does not link {', '.join(missing)}")
    archives, objects, others = set(), set(), set()
    for path in elves[package] if targets else []:
        a, o = compiled_in(arguments.build, targets[path.name])
        archives, objects = archives | a, objects | o
    # Without what the libraries in other packages are made of.
    for other in {providers[soname] for path in elves[package] for soname in needed(path)[0] if soname in providers}:
        for path in elves[other] if targets and other != package else []:
            a, o = compiled_in(arguments.build, targets[path.name])
            archives, others = archives - a, others | o
    linked = owners(archives)
    for archive in sorted(archives):
        if archive not in linked:
            sys.exit(f"sbom.py: {archive} belongs to no package")
        document.relate(document.own, "STATIC_LINK", document.add_debian(linked[archive]))
    for header_package in sorted(set(owners(headers_of(arguments.build, objects - others)).values())):
        document.relate(document.add_debian(header_package), "BUILD_DEPENDENCY_OF", document.own)

    # The pages are part of the program.
    if arguments.npm and "usr/bin/fringeslam" in identifiers:
        for path, locked in json.loads(arguments.npm.read_text())["packages"].items():
            if path and not locked.get("dev"):
                document.relate(document.own, "CONTAINS", document.add_npm(path.split("node_modules/")[-1], locked))
            elif path == "node_modules/esbuild":
                document.relate(document.add_npm("esbuild", locked), "BUILD_TOOL_OF", document.own)
    return document


def created_time():
    seconds = int(os.environ.get("SOURCE_DATE_EPOCH") or datetime.datetime.now().timestamp())
    return datetime.datetime.fromtimestamp(seconds, datetime.timezone.utc).strftime("%Y-%m-%dT%H:%M:%SZ")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--version", required=True)
    parser.add_argument("--build", required=True, type=pathlib.Path)
    parser.add_argument("--npm", type=pathlib.Path)
    parser.add_argument("stages", nargs="+", metavar="PACKAGE=STAGE")
    arguments = parser.parse_args()
    stages = {name: pathlib.Path(folder) for name, folder in (stage.split("=", 1) for stage in arguments.stages)}
    elves, providers = {}, {}
    for package, stage in stages.items():
        elves[package] = sorted(p for p in stage.rglob("*") if p.is_file() and not p.is_symlink() and is_elf(p))
        for path in elves[package]:
            soname = needed(path)[1]
            if soname:
                providers[soname] = package
    # dpkg searches its whole database for each query.
    libraries = [cached_libraries().get(soname) for paths in elves.values() for path in paths for soname in needed(path)[0]]
    owners({name for path in libraries if path for name in (path, os.path.realpath(path))})
    for package, stage in stages.items():
        file = stage / "usr/share/doc" / package / f"{package}.spdx.json"
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(describe(package, stages, elves, providers, arguments).text())
        file.chmod(0o644)


if __name__ == "__main__":
    main()
