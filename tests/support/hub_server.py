"""A stand-in for the Hugging Face hub, over real HTTP, with its files in memory.

It has the calls that sharing a policy makes.

It is written from what the client sends and expects, and it is not the hub: whether that takes what
we send is not tested.
"""

import base64
import hashlib
import json
from dataclasses import dataclass, field

import yaml
from fastapi import FastAPI, Request, Response
from fastapi.responses import JSONResponse

TOKEN = "hf_of_ada"


@dataclass
class Repository:
    """What one repository holds: the files of each commit, oldest first."""

    private: bool
    commits: list[dict[str, bytes]] = field(default_factory=lambda: [{}])

    def sha(self, number=-1):
        state = repr((number % len(self.commits), sorted(self.commits[number])))
        return hashlib.sha1(state.encode()).hexdigest()

    def files_at(self, revision):
        """The files of a commit; None for one that is not there."""
        if revision == "main":
            return self.commits[-1]
        commits = {self.sha(number): files for number, files in enumerate(self.commits)}
        return commits.get(revision)


def refusal(status, code, message):
    headers = {"X-Error-Code": code, "X-Error-Message": message} if code else {}
    return JSONResponse({"error": message}, status, headers)


def create_hub():
    """The app; `state.repositories` has what was written, `state.calls` the requests."""
    app = FastAPI()
    repositories, blobs, calls = {}, {}, []
    app.state.repositories, app.state.calls = repositories, calls

    @app.middleware("http")
    async def note(request, call_next):
        calls.append(f"{request.method} {request.url.path}")
        is_open = request.method in ("GET", "HEAD") or "/lfs-upload/" in request.url.path
        if not is_open and request.headers.get("authorization") != f"Bearer {TOKEN}":
            return refusal(401, None, "Invalid username or password.")
        return await call_next(request)

    @app.post("/api/validate-yaml")
    async def validate(request: Request):
        text = (await request.json())["content"]
        metadata = yaml.safe_load(text.split("---")[1])
        wrong = [] if isinstance(metadata, dict) else [{"message": "the metadata is no mapping"}]
        return JSONResponse({"errors": wrong, "warnings": []}, 400 if wrong else 200)

    @app.post("/api/repos/create")
    async def create(request: Request):
        wanted = await request.json()
        name = f"{wanted['organization']}/{wanted['name']}"
        url = {"url": f"{request.base_url}{name}"}
        if name in repositories:
            return JSONResponse(url | {"error": "You already created this model repo"}, 409)
        repositories[name] = Repository(wanted.get("visibility") == "private")
        return url

    @app.post("/api/models/{owner}/{name}/preupload/{revision}")
    async def preupload(owner, name, request: Request):
        if f"{owner}/{name}" not in repositories:
            return refusal(404, "RepoNotFound", "Repository not found")
        files = []
        for path in (file["path"] for file in (await request.json())["files"]):
            mode = "lfs" if path.endswith(".onnx") else "regular"
            files.append({"path": path, "uploadMode": mode, "shouldIgnore": False})
        return {"files": files}

    @app.post("/{owner}/{name}.git/info/lfs/objects/batch")
    async def batch(request: Request):
        objects = (await request.json())["objects"]
        for blob in objects:
            upload = {"href": f"{request.base_url}lfs-upload/{blob['oid']}", "header": {}}
            blob["actions"] = {"upload": upload}
        return {"transfer": "basic", "objects": objects}

    @app.put("/lfs-upload/{oid}")
    async def upload(oid, request: Request):
        content = await request.body()
        if hashlib.sha256(content).hexdigest() != oid:
            return refusal(400, None, "the content is not what was announced")
        blobs[oid] = content
        return Response()

    @app.post("/api/models/{owner}/{name}/commit/{revision}")
    async def commit(owner, name, request: Request):
        repository = repositories[f"{owner}/{name}"]
        files = dict(repository.commits[-1])
        for line in (await request.body()).splitlines():
            operation = json.loads(line)
            file = operation["value"]
            if operation["key"] == "file":
                files[file["path"]] = base64.b64decode(file["content"])
            elif operation["key"] == "lfsFile":
                files[file["path"]] = blobs[file["oid"]]
        repository.commits.append(files)
        url = f"{request.base_url}{owner}/{name}/commit/{repository.sha()}"
        return {"commitUrl": url, "commitOid": repository.sha(), "success": True}

    @app.get("/api/models/{owner}/{name}")
    @app.get("/api/models/{owner}/{name}/revision/{revision}")
    async def info(owner, name, revision="main"):
        repository = repositories.get(f"{owner}/{name}")
        if repository is None:
            return refusal(404, "RepoNotFound", "Repository not found")
        files = repository.files_at(revision)
        if files is None:
            return refusal(404, "RevisionNotFound", f"Invalid rev id: {revision}")
        siblings = [{"rfilename": path} for path in files]
        return {"id": f"{owner}/{name}", "sha": repository.sha(), "siblings": siblings, "tags": []}

    @app.api_route("/{owner}/{name}/resolve/{revision}/{path:path}", methods=["GET", "HEAD"])
    async def resolve(owner, name, revision, path):
        repository = repositories[f"{owner}/{name}"]
        content = repository.files_at(revision)[path]
        sha = repository.sha() if revision == "main" else revision
        headers = {"X-Repo-Commit": sha, "ETag": f'"{hashlib.sha256(content).hexdigest()}"'}
        return Response(content, headers=headers, media_type="application/octet-stream")

    return app
