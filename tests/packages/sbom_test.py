# SPDX-License-Identifier: Apache-2.0
"""Bills of materials: SPDX 2.3's rules, and the contents against what the loader, dpkg and the files say."""
import hashlib
import json
import os
import pathlib
import re
import subprocess
import sys
import tempfile
import unittest

SOURCE = pathlib.Path(os.environ["FRINGESLAM_SOURCE_DIR"])
BUILD = pathlib.Path(os.environ["FRINGESLAM_BUILD_DIR"])
NPM = os.environ.get("FRINGESLAM_NPM", "")
COMPONENTS = dict(entry.split("=") for entry in os.environ["FRINGESLAM_COMPONENTS"].split())
sys.path.insert(0, str(SOURCE / "tools/cmake/debian"))
import sbom

HAS_NINJA = (BUILD / "build.ninja").exists()


def output_of(*command):
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout


class Licenses(unittest.TestCase):
    def test_synopses_become_expressions(self):
        for synopsis, expression in {
            "Expat": "MIT",
            "GPL-2+": "GPL-2.0-or-later",
            "LGPL-2.1": "LGPL-2.1-only",
            "BSD-3-clause or GPL-2": "BSD-3-Clause OR GPL-2.0-only",
            "Apache-2.0 AND BSD-3-Clause": "Apache-2.0 AND BSD-3-Clause",
            # A comma binds weaker.
            "GPL-3+ or Expat, and Zlib": "(GPL-3.0-or-later OR MIT) AND Zlib",
            "GPL-2 and Zlib or Expat": "(GPL-2.0-only AND Zlib) OR MIT",
            "Strange and MIT": "LicenseRef-Strange AND MIT",
        }.items():
            self.assertEqual(sbom.license_expression(synopsis, lambda name: "LicenseRef-" + name), expression)

    def test_copyright_files_are_read(self):
        text = """Format: https://www.debian.org/doc/packaging-manuals/copyright-format/1.0/

Files: *
Copyright: 2001 A
           2002 B
License: Expat or Own

Files: debian/*
Copyright: C
License: GPL-2+

License: Own
 First line.
 .
 Last line.

License: GPL-2+
 Text.
"""
        legal = sbom.read_copyright("libx1", text)
        self.assertEqual(legal.expression, "MIT OR LicenseRef-libx1-Own")
        self.assertEqual(legal.holders, "2001 A\n2002 B")
        self.assertEqual(legal.extracted, {"LicenseRef-libx1-Own": ("Own", "First line.\n\nLast line.")})
        self.assertIn("GPL-2+", legal.others)
        self.assertIsNone(sbom.read_copyright("libx1", "This is the package of libx.\n\nFiles: *\nLicense: MIT\n"))


class Documents(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.TemporaryDirectory()
        root = pathlib.Path(cls.folder.name)
        cls.stages = {package: root / component for component, package in COMPONENTS.items()}
        for component in COMPONENTS:
            output_of("cmake", "--install", str(BUILD), "--component", component, "--prefix", str(root / component / "usr"))
        cls.texts = cls.write()
        cls.documents = {package: json.loads(text) for package, text in cls.texts.items()}

    @classmethod
    def tearDownClass(cls):
        cls.folder.cleanup()

    @classmethod
    def write(cls):
        subprocess.run(
            [sys.executable, "-B", str(SOURCE / "tools/cmake/debian/sbom.py"), "--version", "1.2.3", "--build", str(BUILD),
             *(["--npm", NPM] if NPM else []), *(f"{package}={stage}" for package, stage in cls.stages.items())],
            check=True, env=dict(os.environ, SOURCE_DATE_EPOCH="86400"))
        return {package: (stage / f"usr/share/doc/{package}/{package}.spdx.json").read_text()
                for package, stage in cls.stages.items()}

    def related(self, package, relation, inverse=False):
        """Returns the names of the packages that have this relation with a package or its files."""
        document = self.documents[package]
        names = {p["SPDXID"]: p["name"] for p in document["packages"]}
        sides = ("relatedSpdxElement", "spdxElementId")[:: -1 if inverse else 1]
        return {names[r[sides[0]]] for r in document["relationships"]
                if r["relationshipType"] == relation and r[sides[0]] in names}

    def test_fields_that_spdx_requires(self):
        namespaces = set()
        for document in self.documents.values():
            self.assertEqual(document["spdxVersion"], "SPDX-2.3")
            self.assertEqual(document["dataLicense"], "CC0-1.0")
            self.assertEqual(document["SPDXID"], "SPDXRef-DOCUMENT")
            self.assertTrue(document["name"])
            self.assertRegex(document["documentNamespace"], r"^https://[^#\s]+$")
            namespaces.add(document["documentNamespace"])
            self.assertEqual(document["creationInfo"]["created"], "1970-01-02T00:00:00Z")
            for creator in document["creationInfo"]["creators"]:
                self.assertRegex(creator, r"^(Tool|Organization|Person): \S")
            for package in document["packages"]:
                self.assertTrue(package["name"])
                self.assertTrue(package["versionInfo"])
                self.assertRegex(package["downloadLocation"], r"^(NOASSERTION|NONE|https://\S+)$")
                self.assertEqual("packageVerificationCode" in package, package["filesAnalyzed"])
                for reference in package.get("externalRefs", []):
                    self.assertEqual(reference["referenceCategory"], "PACKAGE-MANAGER")
                    self.assertRegex(reference["referenceLocator"], r"^pkg:(deb/debian|npm)/[A-Za-z0-9.%/_-]+@[^\s@:+]+$")
            for file in document["files"]:
                self.assertRegex(file["fileName"], r"^\./")
                self.assertIn("SHA1", [checksum["algorithm"] for checksum in file["checksums"]])
        self.assertEqual(len(namespaces), len(self.documents))

    def test_identifiers_are_unique_and_references_resolve(self):
        for package, document in self.documents.items():
            identifiers = [e["SPDXID"] for e in [document, *document["packages"], *document["files"]]]
            self.assertEqual(len(identifiers), len(set(identifiers)))
            for identifier in identifiers:
                self.assertRegex(identifier, r"^SPDXRef-[A-Za-z0-9.-]+$")
            for relation in document["relationships"]:
                self.assertIn(relation["spdxElementId"], identifiers)
                self.assertIn(relation["relatedSpdxElement"], identifiers)
            described = [r["relatedSpdxElement"] for r in document["relationships"] if r["relationshipType"] == "DESCRIBES"]
            self.assertEqual(described, [f"SPDXRef-Package-{package}"])
            # Nothing is listed without a reason.
            used = {r[side] for r in document["relationships"] for side in ("spdxElementId", "relatedSpdxElement")}
            self.assertEqual(set(identifiers) - used, set())

    def test_licenses_are_spdx_or_extracted(self):
        known = set(sbom.LICENSES.values())
        for document in self.documents.values():
            extracted = {e["licenseId"] for e in document["hasExtractedLicensingInfos"]}
            used = set()
            for package in document["packages"]:
                expression = package["licenseDeclared"]
                if expression == "NOASSERTION":
                    self.assertTrue(package["licenseComments"], package["name"])
                    continue
                names = set(re.split(r"[\s()]+|\bAND\b|\bOR\b", expression)) - {""}
                used |= {name for name in names if name.startswith("LicenseRef-")}
                self.assertEqual(names - known - extracted, set(), package["name"])
            self.assertEqual(used, extracted)
            for entry in document["hasExtractedLicensingInfos"]:
                self.assertRegex(entry["licenseId"], r"^LicenseRef-[A-Za-z0-9.-]+$")
                self.assertTrue(entry["extractedText"])

    def test_files_are_those_of_the_package(self):
        for package, document in self.documents.items():
            own = next(p for p in document["packages"] if p["name"] == package)
            excluded = own["packageVerificationCode"]["packageVerificationCodeExcludedFiles"]
            stage = self.stages[package]
            present = {"./" + p.relative_to(stage).as_posix() for p in stage.rglob("*") if p.is_file() and not p.is_symlink()}
            self.assertEqual({file["fileName"] for file in document["files"]}, present - set(excluded))
            sums = []
            for file in document["files"]:
                data = (stage / file["fileName"]).read_bytes()
                for checksum in file["checksums"]:
                    self.assertEqual(checksum["checksumValue"], hashlib.new(checksum["algorithm"], data).hexdigest())
                sums.append(hashlib.sha1(data).hexdigest())
            code = hashlib.sha1("".join(sorted(sums)).encode()).hexdigest()
            self.assertEqual(own["packageVerificationCode"]["packageVerificationCodeValue"], code)

    def test_libraries_are_those_that_the_loader_finds(self):
        for package, stage in self.stages.items():
            found = {}  # by soname: spellings of the path
            folders = {str(p.parent) for s in self.stages.values() for p in s.rglob("libfringeslam_*.so.0")}
            for file in filter(sbom.is_elf, (p for p in stage.rglob("*") if p.is_file() and not p.is_symlink())):
                direct = set(re.findall(r"NEEDED\s+(\S+)", output_of("objdump", "-p", str(file))))
                loaded = subprocess.run(["ldd", str(file)], check=True, capture_output=True, text=True,
                                        env=dict(os.environ, LD_LIBRARY_PATH=":".join(sorted(folders)))).stdout
                for name, path in re.findall(r"^\s*(\S+)(?: => (\S+))? \(0x", loaded, flags=re.M):
                    name, path = os.path.basename(name), path or name
                    if name in direct and not name.startswith("libfringeslam_"):
                        found[name] = (path, os.path.realpath(path), "/usr" + path, path.removeprefix("/usr"))
            listed = subprocess.run(["dpkg", "-S", *(path for paths in found.values() for path in paths)],
                                    capture_output=True, text=True).stdout if found else ""
            owner = {line.split(": ")[1]: line.split(":")[0] for line in listed.splitlines()}
            expected = {(name, next(owner[path] for path in paths if path in owner)) for name, paths in found.items()}
            names = {owner for name, owner in expected if not re.match(r"lib(blas|lapack)\.so", name)}
            linked = self.related(package, "DYNAMIC_LINK")
            self.assertEqual(names - linked, set())
            # Of BLAS and LAPACK, any implementation may be the one that the loader finds here.
            self.assertLessEqual(linked - names, {"liblapack3", "libblas3", *COMPONENTS.values()})
            self.assertEqual(bool(expected), package != "libfringeslam-dev", "library without dependencies")

    def test_own_packages_depend_on_the_library(self):
        for component in ("program", "python"):
            if component in COMPONENTS:
                self.assertIn("libfringeslam0", self.related(COMPONENTS[component], "DEPENDS_ON"))
        self.assertNotIn("libfringeslam0", self.related("libfringeslam0", "DEPENDS_ON"))

    @unittest.skipUnless(HAS_NINJA, "only ninja records what the build compiled")
    def test_what_is_compiled_in(self):
        self.assertIn("libceres-dev", self.related("libfringeslam0", "STATIC_LINK"))
        self.assertNotIn("libceres-dev", self.related("fringeslam", "STATIC_LINK"))
        library = self.related("libfringeslam0", "BUILD_DEPENDENCY_OF", inverse=True)
        program = self.related("fringeslam", "BUILD_DEPENDENCY_OF", inverse=True)
        self.assertLessEqual({"libeigen3-dev", "librandom123-dev", "libstdc++-12-dev"}, library)
        self.assertLessEqual({"libcli11-dev", "nlohmann-json3-dev"}, program)
        self.assertNotIn("libcli11-dev", library)
        self.assertNotIn("libopenvdb-dev", program)
        self.assertFalse([name for name in library | program if "gtest" in name or "pybind11" in name])
        if "python" in COMPONENTS:
            self.assertIn("pybind11-dev", self.related("python3-fringeslam", "BUILD_DEPENDENCY_OF", inverse=True))

    @unittest.skipUnless(NPM, "built without the web pages")
    def test_npm_packages_are_those_of_the_lock_file(self):
        wanted = json.loads((pathlib.Path(NPM).parent / "package.json").read_text())["dependencies"]
        found = {p["name"]: p for p in self.documents["fringeslam"]["packages"] if "-npm-" in p["SPDXID"]}
        self.assertEqual({name: found[name]["versionInfo"] for name in wanted}, wanted)
        self.assertEqual(set(found) - set(wanted), {"esbuild"})
        for package in found.values():
            self.assertEqual([len(c["checksumValue"]) for c in package["checksums"] if c["algorithm"] == "SHA512"], [128])
        page = self.documents["libfringeslam0"]
        self.assertFalse([p["name"] for p in page["packages"] if "-npm-" in p["SPDXID"]])

    def test_the_bytes_depend_on_nothing_else(self):
        self.assertEqual(self.write(), self.texts)
        for text in self.texts.values():
            for folder in (str(SOURCE), str(BUILD), self.folder.name):
                self.assertNotIn(folder, text)


if __name__ == "__main__":
    unittest.main()
