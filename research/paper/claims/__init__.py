"""The paper's statements, each with a verdict from shipped results; their page."""
