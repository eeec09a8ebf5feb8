"""A model that plays every instance of a card by calling tools, which it finds by MCP alone.

Any OpenAI-compatible API with tools does: OPENAI_BASE_URL and OPENAI_API_KEY say which. Any other client of MCP, an
assistant for programmers say, plays as well: its server is the card's address and `/mcp`.

    .venv-agents/bin/python examples/agents/mcp_tools.py http://127.0.0.1:8000/agents/TOKEN --model MODEL
"""

import argparse
import asyncio
import json

import httpx
from fastmcp import Client
from openai import AsyncOpenAI

TASK = "Play instance {index} to its end: begin it, then move until it is finished."
REMEMBERED = 30
"""Messages that the model is shown of an instance, beside the first two."""


def as_tool(tool):
    """Return a tool of MCP as the API takes it."""
    told = {"name": tool.name, "description": tool.description, "parameters": tool.inputSchema}
    return {"type": "function", "function": told}


def recent(messages):
    """Return the first two messages and the last ones, beginning with a call and not with its answer."""
    last = messages[2:][-REMEMBERED:]
    while last and last[0]["role"] == "tool":
        last.pop(0)
    return [*messages[:2], *last]


async def play(client, api, model, index):
    """Let the model call tools until an instance is finished; return the moves made, None where it calls no more."""
    tools = [as_tool(each) for each in await client.list_tools()]
    messages = [
        {"role": "system", "content": client.initialize_result.instructions},
        {"role": "user", "content": TASK.format(index=index)},
    ]
    while True:
        answer = await api.chat.completions.create(
            model=model, messages=recent(messages), tools=tools
        )
        said = answer.choices[0].message
        if not said.tool_calls:
            return None
        messages.append(said.model_dump(exclude_none=True))
        for call in said.tool_calls:
            try:
                given = json.loads(call.function.arguments)
            except ValueError:
                given = {}
            result = await client.call_tool(call.function.name, given, raise_on_error=False)
            text = "\n".join(each.text for each in result.content if each.type == "text")
            messages.append({"role": "tool", "tool_call_id": call.id, "content": text})
            seen = result.structured_content
            if seen and seen["done"] and seen["observation"]["index"] == index:
                return seen["observation"]["step"]


async def main():
    """Play each instance that is not finished, then close the card."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("card", help="the card's address")
    parser.add_argument("--model", required=True, help="as the API calls it")
    given = parser.parse_args()
    card = httpx.get(given.card, timeout=60).raise_for_status().json()
    if not card["state"]["begun"]:
        said = {"agent": "tools by MCP", "version": "1", "model": given.model}
        httpx.post(given.card, json=said, timeout=60).raise_for_status()
    async with Client(f"{given.card}/mcp") as client, AsyncOpenAI() as api:
        for index in sorted(set(range(card["instances"])) - set(card["state"]["finished"])):
            moves = await play(client, api, given.model, index)
            said = "the model called no more tools" if moves is None else f"{moves} moves"
            print(f"instance {index}: {said}", flush=True)
    httpx.post(f"{given.card}/close", timeout=60).raise_for_status()
    print("the card is closed")


if __name__ == "__main__":
    asyncio.run(main())
