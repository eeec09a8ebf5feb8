"""The statements of the paper, each with a verdict from shipped results, and the page that shows them."""
