"""A model plays every instance of a card by calling tools that it finds by MCP.

Any OpenAI-compatible API with tools does: OPENAI_BASE_URL and OPENAI_API_KEY say which. Any other
client of MCP, an assistant for programmers say, plays as well: its server is the card's address and
`/mcp`.

    CARD=http://127.0.0.1:8000/agents/TOKEN
    .venv-agents/bin/python examples/agents/mcp_tools.py $CARD --model MODEL
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
    """A tool of MCP in the form of the API."""
    function = {"name": tool.name, "description": tool.description, "parameters": tool.inputSchema}
    return {"type": "function", "function": function}


def recent(messages):
    """The first two messages and the last ones, beginning with a call."""
    last = messages[2:][-REMEMBERED:]
    while last and last[0]["role"] == "tool":
        last.pop(0)
    return [*messages[:2], *last]


async def play(client, api, model, index):
    """Let the model call tools until an instance is finished; return its moves.

    None if the model calls no more tools.
    """
    tools = [as_tool(tool) for tool in await client.list_tools()]
    messages = [
        {"role": "system", "content": client.initialize_result.instructions},
        {"role": "user", "content": TASK.format(index=index)},
    ]
    while True:
        answer = await api.chat.completions.create(
            model=model, messages=recent(messages), tools=tools
        )
        message = answer.choices[0].message
        if not message.tool_calls:
            return None
        messages.append(message.model_dump(exclude_none=True))
        for call in message.tool_calls:
            try:
                arguments = json.loads(call.function.arguments)
            except ValueError:
                arguments = {}
            outcome = await client.call_tool(call.function.name, arguments, raise_on_error=False)
            text = "\n".join(part.text for part in outcome.content if part.type == "text")
            messages.append({"role": "tool", "tool_call_id": call.id, "content": text})
            seen = outcome.structured_content
            if seen and seen["done"] and seen["observation"]["index"] == index:
                return seen["observation"]["step"]


async def main():
    """Play each instance that is not finished, then close the card."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("card", help="the card's address")
    parser.add_argument("--model", required=True, help="as the API calls it")
    options = parser.parse_args()
    card = httpx.get(options.card, timeout=60).raise_for_status().json()
    if not card["state"]["begun"]:
        agent = {"agent": "tools by MCP", "version": "1", "model": options.model}
        httpx.post(options.card, json=agent, timeout=60).raise_for_status()
    async with Client(f"{options.card}/mcp") as client, AsyncOpenAI() as api:
        for index in sorted(set(range(card["instances"])) - set(card["state"]["finished"])):
            moves = await play(client, api, options.model, index)
            sentence = "the model called no more tools" if moves is None else f"{moves} moves"
            print(f"instance {index}: {sentence}", flush=True)
    httpx.post(f"{options.card}/close", timeout=60).raise_for_status()
    print("the card is closed")


if __name__ == "__main__":
    asyncio.run(main())
