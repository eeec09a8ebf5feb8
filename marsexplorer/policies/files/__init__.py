"""Policy files: the card in their header, and weights that are read so that nothing in a file can run.

Understood are safetensors with a card, and ONNX models. What plays our own networks is in
`policies.network`; what is made elsewhere becomes an `ImportedPolicy`.
"""
