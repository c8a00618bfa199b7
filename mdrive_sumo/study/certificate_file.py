"""Files of certificates beside a suite: one certificate for each scenario, of one version of the suite."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar, Generic, Self, TypeVar

from pydantic import BaseModel, ConfigDict

from mdrive_sumo.core.output_files import write_text
from mdrive_sumo.runs.evaluate import report_write_errors
from mdrive_sumo.scenario.scenario import load_model
from mdrive_sumo.scenario.suite import Suite


class CertificatePart(BaseModel):
    """A part of such a file."""

    model_config = ConfigDict(frozen=True, extra="forbid", use_attribute_docstrings=True)


class ScenarioCertificate(CertificatePart):
    """What was found of a scenario."""

    scenario: str


CertificateT = TypeVar("CertificateT", bound=ScenarioCertificate)


class CertificateFile(CertificatePart, Generic[CertificateT]):
    """The certificates of a suite."""

    NAME: ClassVar[str]
    """Of the file in the folder of the suite."""
    format: Any = ""
    suite_checksum: str
    certificates: tuple[CertificateT, ...]

    def of(self, suite: Suite) -> Mapping[str, CertificateT]:
        """Return the certificates by scenario id; none if they belong to another version of the suite."""
        kept = self.certificates if self.suite_checksum == suite.checksum() else ()
        return {certificate.scenario: certificate for certificate in kept}

    @classmethod
    def read(cls, folder: Path) -> Self | None:
        """Return the certificates in a suite's folder, also of another version of the suite. Raises InputError."""
        path = folder / cls.NAME
        return load_model(path, cls) if path.is_file() else None

    @classmethod
    def load(cls, suite: Suite) -> Mapping[str, CertificateT]:
        """Return the certificates beside a suite or its parts by scenario id; none of a suite that has changed since.

        Raises InputError for an unreadable file.
        """
        files = ((part, cls.read(part.folder)) for part in suite.parts or (suite,))
        return {name: one for part, file in files if file is not None for name, one in file.of(part).items()}

    @classmethod
    def write(cls, suite: Suite, found: Mapping[str, CertificateT | None]) -> int:
        """Write the certificates of a suite in its order, and return their number. Raises InputError.

        found: those of scenarios that were examined now, None for one that could not be driven; the file keeps others.
        """
        before = cls.read(suite.folder)
        by_name = {one.scenario: one for one in before.certificates} if before else {}
        known = (found.get(scenario.id, by_name.get(scenario.id)) for scenario in suite.scenarios)
        content = cls(suite_checksum=suite.checksum(), certificates=tuple(one for one in known if one is not None))
        with report_write_errors(suite.folder / cls.NAME):
            content.save(suite.folder)
        return len(content.certificates)

    def save(self, folder: Path) -> None:
        """Write the file, one certificate a line."""
        lines = ",\n".join(certificate.model_dump_json() for certificate in self.certificates)
        head = self.model_dump_json(include={"format", "suite_checksum"})
        write_text(folder / self.NAME, f'{head[:-1]},"certificates":[\n{lines}\n]}}\n')
