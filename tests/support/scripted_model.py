"""A stand-in of an OpenAI-compatible API: a rule reads what agents see."""

import json
import random
import re
import threading
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

from marsexplorer.policies import load
from tests.support.agents import codes_of

ROW = re.compile(r"^ *\d+ ([?.#@]+)$", re.MULTILINE)
COMPASS = ("north", "east", "south", "west")


class ScriptedModel:
    """What the stand-in answers, and what it was asked.

    actions  what it draws from where it is shown no text frame of MarsExplorer
    """

    def __init__(self, actions):
        self._actions, self._draw = actions, random.Random(3)
        self._rule = load("frontier-cost")
        self.asked = []

    def action(self, text):
        """Return the next move by the newest text frame: the rule's, or one that is drawn."""
        grid = ROW.findall(text)
        if not grid:
            return self._draw.choice(self._actions)
        if "step 0," in text or "so far: 0" in text or '"step": 0' in text:
            self._rule.reset(1)
        return COMPASS[self._rule.act(codes_of(grid))]

    def answer(self, body):
        """Return the message that answers a request."""
        self.asked.append(body)
        content = body["messages"][-1]["content"]
        if isinstance(content, list):  # text and picture
            assert content[1]["image_url"]["url"].startswith("data:image/png;base64,")
            content = content[0]["text"]
        if body.get("tools") and {"begin", "move"} <= {
            tool["function"]["name"] for tool in body["tools"]
        }:
            return self._tool_call(content)
        return {"role": "assistant", "content": f"I see.\n{self.action(content)}"}

    def _tool_call(self, content):
        index = int(re.search(r"instance (\d+)", content)[1])
        name, arguments = "begin", {"index": index}
        if not content.startswith("Play"):
            name, arguments = "move", {"index": index, "action": self.action(content)}
        call = {"name": name, "arguments": json.dumps(arguments)}
        calls = [{"id": f"call{len(self.asked)}", "type": "function", "function": call}]
        return {"role": "assistant", "content": None, "tool_calls": calls}


@contextmanager
def scripted_model(actions=COMPASS):
    """Yield a stand-in, and its address for OPENAI_BASE_URL."""
    model = ScriptedModel(actions)

    class Handler(BaseHTTPRequestHandler):
        protocol_version = "HTTP/1.1"

        def log_message(self, *arguments):
            pass

        def do_POST(self):
            body = json.loads(self.rfile.read(int(self.headers["Content-Length"])))
            message = model.answer(body)
            whole = {"id": "x", "created": 1, "model": body["model"]}
            usage = {"prompt_tokens": 7, "completion_tokens": 3, "total_tokens": 10}
            end = {
                "index": 0,
                "finish_reason": "tool_calls" if message.get("tool_calls") else "stop",
            }
            choices = [{**end, "message": message}]
            answer = {**whole, "object": "chat.completion", "choices": choices, "usage": usage}
            text, kind = json.dumps(answer), "application/json"
            self.send_response(200)
            self.send_header("Content-Type", kind)
            self.send_header("Content-Length", str(len(text)))
            self.end_headers()
            self.wfile.write(text.encode())

    with ThreadingHTTPServer(("127.0.0.1", 0), Handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        try:
            yield model, f"http://127.0.0.1:{server.server_port}/v1"
        finally:
            server.shutdown()
