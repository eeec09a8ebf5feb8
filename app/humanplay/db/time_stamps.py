"""Time stamps of the chain's head by an authority (RFC 3161): proof that everything up to it stood at that time.

A stamp is the authority's answer, kept as a file; anybody can check it offline with the authority's certificate, also by
`openssl ts -verify`. What is stamped is the head as `verify` prints it: 64 hexadecimal digits in ASCII.
"""

from __future__ import annotations

import hashlib
import ssl
import urllib.error
import urllib.request
import warnings
from contextlib import suppress
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING

from humanplay.db.chain import Head, head, select
from humanplay.db.checks import DIGEST
from humanplay.db.database import reading
from humanplay.db.file import StoreError
from humanplay.db.resimulation import Finding

if TYPE_CHECKING:
    from rfc3161_client import TimeStampResponse


@dataclass(frozen=True)
class TimeStamp:
    """The head (hex) that a stamp was made for, and when; `fault` is None unless it is no stamp of this database's chain."""

    head: str
    at: datetime
    fault: Finding | None = None


def request_stamp(database: Path, authority: str) -> tuple[Head, bytes]:
    """Return the chain's head and the stamp that an authority (URL) makes of it; StoreError when there is none of either."""
    from rfc3161_client import HashAlgorithm, TimestampRequestBuilder

    with reading(database) as conn:
        found = head(conn)
    if not found.entries:
        raise StoreError(f"{database} has no chain to be stamped: nothing was recorded in it")
    request = TimestampRequestBuilder(found.head.encode(), HashAlgorithm.SHA256).build()
    headers = {"Content-Type": "application/timestamp-query"}
    try:
        asked = urllib.request.Request(authority, request.as_bytes(), headers)
        with urllib.request.urlopen(asked, timeout=30) as answer:
            stamp: bytes = answer.read(100_000)
        made = _parse(stamp)
    except (OSError, ValueError) as error:
        if isinstance(error, urllib.error.HTTPError):
            error.close()
        raise StoreError(
            f"the authority {authority} gave no time stamp ({error}): try again, or another --authority"
        ) from error
    if made.tst_info.message_imprint.message != hashlib.sha256(found.head.encode()).digest():
        raise StoreError(f"the authority {authority} stamped something else: nothing was kept")
    return found, stamp


def read_stamp(path: Path, database: Path, certificates: Path | None) -> TimeStamp:
    """Return what a stamp's file says of a database; StoreError when it cannot be read.

    certificates  PEM of the authority's root; None: those that this machine trusts
    """
    from cryptography import x509
    from rfc3161_client import VerificationError, VerifierBuilder

    where = f"time stamp {path}"
    try:
        made = _parse(path.read_bytes())
        roots = []
        if certificates is not None:
            roots = x509.load_pem_x509_certificates(certificates.read_bytes())
        else:
            for each in ssl.create_default_context().get_ca_certs(binary_form=True):
                # some break the standard
                with warnings.catch_warnings(action="ignore"), suppress(ValueError):
                    roots.append(x509.load_der_x509_certificate(each))
    except (OSError, ValueError) as error:
        raise StoreError(
            f"cannot read the time stamp {path} or its certificates: {error}; give a file that `stamp` wrote, and the "
            "authority's root as PEM"
        ) from error
    imprint, at = made.tst_info.message_imprint.message, made.tst_info.gen_time
    with reading(database) as conn:
        heads = select(conn, "SELECT head FROM chain ORDER BY number DESC")
        said = (each for (each,) in heads)
        head = next((h for h in said if hashlib.sha256(h.encode()).digest() == imprint), "")
    fault = None
    if not head:
        missing = "no entry with the head that was stamped: gone, made anew, or of another database"
        fault = Finding(where, DIGEST, imprint.hex(), missing)
    try:
        VerifierBuilder(roots=roots).build().verify(made, imprint)
    except (VerificationError, ValueError) as error:  # ValueError: no root at all
        why = f"{error} (--certificate names its root)"
        fault = Finding(where, "signature", "of the authority", why)
    return TimeStamp(head, at, fault)


def _parse(stamp: bytes) -> TimeStampResponse:
    """Return a stamp; ValueError when it is none, or a refusal."""
    from rfc3161_client import PKIStatus, decode_timestamp_response

    made = decode_timestamp_response(stamp)
    if PKIStatus(made.status) != PKIStatus.GRANTED:
        why = ", ".join(made.status_string) or PKIStatus(made.status).name
        raise ValueError(f"it refused: {why}")
    return made
