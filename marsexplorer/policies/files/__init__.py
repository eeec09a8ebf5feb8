"""Policy files: the card in their header, and weights that are read so that nothing in a file can run.

Understood are safetensors with a card, ONNX models, and the zips of Stable-Baselines3. What plays our own networks is in
`policies.network`; what is made elsewhere becomes an `ImportedPolicy`.
"""
