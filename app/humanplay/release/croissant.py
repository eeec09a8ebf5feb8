"""Croissant 1.1 metadata (JSON-LD), for machines that look for data sets.

They say what files there are and what their columns mean, and are built with mlcroissant's own
classes. Two things cannot be said through them and are added to their output: `isLiveDataset` when
it is false, and a list of creators when there is only one.
"""

from __future__ import annotations

import json
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType

from humanplay.db.columns import Column, bundle_reference, bundle_table, summary
from humanplay.release.errors import ReleaseError, library
from humanplay.release.manifest import BUNDLE_DATABASE, ReleaseHeader, sha256
from humanplay.release.tables import PARQUET

ENCODING_FORMATS = {
    **{f"parquet/{table}.parquet": "application/x-parquet" for table in PARQUET},
    "csv/scores.csv": "text/csv",
    BUNDLE_DATABASE: "application/vnd.sqlite3",
}
"""File -> its media type."""

TERMS_OF_1_1 = {
    "arrayShape": "cr:arrayShape",
    "containedIn": "cr:containedIn",
    "isArray": "cr:isArray",
    "description": {"@container": "@language"},
    "name": {"@container": "@language"},
}
"""What the context of Croissant 1.1 has beyond that of 1.0, which mlcroissant writes by default."""


def croissant(
    folder: Path, header: ReleaseHeader, citation: str, licence_url: str
) -> dict[str, object]:
    """The metadata of a release whose tables lie in `folder`.

    Raises:
        ReleaseError: If mlcroissant finds them invalid.
    """
    formats = ENCODING_FORMATS.items()
    with _mlcroissant() as mlc:
        build = _Builder(mlc, folder, header.protocol.environment.about.columns)
        metadata = mlc.Metadata(
            ctx=build.context,
            name=f"humanplay-{header.study}",
            description=header.summary(),
            cite_as=citation,
            license=[licence_url],
            url=header.url,
            version=f"{header.version}.0.0",
            date_published=header.released,
            creators=[mlc.Organization(ctx=build.context, name=name) for name in header.authors],
            keywords=[
                "reinforcement learning",
                "human baseline",
                header.protocol.environment.about.title,
            ],
            distribution=[build.file(name, encoding) for name, encoding in formats],
            record_sets=[
                *(build.record_set(name, f"parquet/{name}.parquet") for name in PARQUET),
                build.record_set("scores", "csv/scores.csv"),
            ],
        )
        facts: dict[str, object] = metadata.to_json()
    creators = facts["creator"] if isinstance(facts["creator"], list) else [facts["creator"]]
    return {**facts, "creator": creators, "isLiveDataset": False}


def write_croissant(folder: Path, header: ReleaseHeader, citation: str, licence_url: str) -> None:
    """Write croissant.json; ReleaseError if mlcroissant finds the metadata invalid."""
    metadata = croissant(folder, header, citation, licence_url)
    text = json.dumps(metadata, indent=2, ensure_ascii=False)
    (folder / "croissant.json").write_text(text + "\n")


@contextmanager
def _mlcroissant() -> Iterator[ModuleType]:
    """Give mlcroissant to a block, without its deprecation warnings.

    Metadata that are not valid become a ReleaseError.
    """
    mlc = library("mlcroissant")
    try:
        with warnings.catch_warnings():
            # rdflib's, about how mlcroissant calls it
            warnings.simplefilter("ignore", DeprecationWarning)
            yield mlc
    except mlc.ValidationError as error:
        raise ReleaseError(f"the Croissant metadata is not valid: {error}") from error


class _Builder:
    """The parts of one release's metadata, built with mlcroissant."""

    def __init__(self, mlc: ModuleType, folder: Path, words: Mapping[str, str]) -> None:
        self._mlc, self._folder, self._words = mlc, folder, words
        rdf = mlc.Rdf(context={**mlc.Rdf().context, **TERMS_OF_1_1})
        self.context = mlc.Context(conforms_to="http://mlcommons.org/croissant/1.1", rdf=rdf)
        of = mlc.DataType
        self._types = {"text": of.TEXT, "integer": of.INTEGER, "real": of.FLOAT, "boolean": of.BOOL}

    def file(self, name: str, encoding: str) -> object:
        """The FileObject of a file, with its size and SHA-256."""
        path = self._folder / name
        size = f"{path.stat().st_size} B"
        facts = {"id": name, "name": name, "content_url": name, "sha256": sha256(path)}
        kind = {"ctx": self.context, "encoding_formats": [encoding]}
        return self._mlc.FileObject(**kind, **facts, content_size=size)

    def record_set(self, table: str, file: str) -> object:
        """The RecordSet of a table that is read from a file."""
        made_from, columns = bundle_table(table, self._words)
        return self._mlc.RecordSet(
            ctx=self.context,
            id=table,
            name=table,
            description=summary(table),
            fields=[self._field(table, file, column) for column in columns],
            key=[f"{table}/{name}" for name in made_from.keys],
        )

    def _field(self, table: str, file: str, column: Column) -> object:
        mlc, other = self._mlc, bundle_reference(table, column.name)
        extract = mlc.Extract(ctx=self.context, column=column.name)
        references = {"references": mlc.Source(ctx=self.context, field=f"{other}/{column.name}")}
        return mlc.Field(
            ctx=self.context,
            id=f"{table}/{column.name}",
            name=column.name,
            description=column.meaning,
            data_types=[self._types[column.exported_type]],
            source=mlc.Source(ctx=self.context, file_object=file, extract=extract),
            **(references if other else {}),
        )
