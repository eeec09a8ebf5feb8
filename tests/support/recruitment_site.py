"""A stand-in for the sites that send people to a study, and take them back."""

import csv
import html
import io
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from threading import Thread
from urllib.parse import parse_qsl, urlencode, urlsplit

PROLIFIC = "https://app.prolific.com"
EXPORTED = (
    "Submission id", "Participant id", "Status", "Custom study tncs accepted at", "Started at", "Completed at", "Reviewed at",
    "Archived at", "Time taken", "Completion code", "Total approvals", "Age", "Sex", "Nationality", "Language",
)  # fmt: skip
"""The columns of Prolific's export of submissions."""
PAGE = "<!doctype html><html lang=en><title>{title}</title><h1>{title}</h1>{body}"
FORM = '<form action="/handed-in"><label>Code <input name="code"></label><button>Hand in</button></form>'


def prolific_export(*rows):
    """Submissions as Prolific exports them, from (participant, status, code) of each."""
    text = io.StringIO()
    table = csv.DictWriter(text, EXPORTED, restval="DATA_EXPIRED")
    table.writeheader()
    for number, (participant, status, code) in enumerate(rows):
        named = {"Participant id": participant, "Status": status, "Completion code": code}
        table.writerow({**named, "Submission id": f"{number:024x}", "Time taken": "612"})
    return text.getvalue()


class RecruitmentSite:
    """A site with a link to the study for each person, and pages to come back to.

    Attributes:
        address: Of the study, as the researcher typed it into the site's form.
        returns: Who came back: path and parameters of each address, in order.
    """

    def __init__(self):
        self.address, self.returns, self._sent = "", [], {}
        site = self

        class Handler(BaseHTTPRequestHandler):
            def do_GET(self):
                content = site._page(self.path).encode()
                self.send_response(200)
                self.send_header("Content-Type", "text/html; charset=utf-8")
                self.send_header("Content-Length", str(len(content)))
                self.end_headers()
                self.wfile.write(content)

            def log_message(self, *arguments):
                pass

        self._server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self.url = f"http://127.0.0.1:{self._server.server_port}"
        self._thread = Thread(target=self._server.serve_forever, daemon=True)
        self._thread.start()

    def close(self):
        self._server.shutdown()
        self._server.server_close()
        self._thread.join()

    def stand_in_at(self, profile, address):
        """Answer for a site of another address in a browser's profile."""

        def answer(route):
            there = urlsplit(route.request.url)
            here = f"{self.url}{there.path}?{there.query}"
            route.fulfill(response=route.fetch(url=here))

        profile.route(f"{address}/**", answer)

    def send(self, person, ids, adds=False):
        """The page on which a person finds the link to the study.

        Args:
            ids: Their parameters; each takes the place of `{{%NAME%}}` or `%NAME%`.
            adds: Whether the site adds the parameters by itself.
        """
        address = self.address
        for name, ident in ids.items():
            for placeholder in (f"{{{{%{name}%}}}}", f"%{name.upper()}%"):
                address = address.replace(placeholder, ident)
        self._sent[person] = f"{address}?{urlencode(ids)}" if adds else address
        return f"{self.url}/task/{person}"

    def _page(self, path):
        parts = urlsplit(path)
        place, _, person = parts.path.strip("/").partition("/")
        if place == "task":
            link = html.escape(self._sent[person], quote=True)
            return PAGE.format(title="A study", body=f'<a href="{link}">Begin the study</a>')
        if place == "form":
            return PAGE.format(title="Hand in your code", body=FORM)
        if place != "favicon.ico":
            self.returns.append((parts.path, dict(parse_qsl(parts.query))))
        return PAGE.format(title="Thank you", body="<p>You have come back.</p>")
