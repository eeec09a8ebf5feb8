"""Policy files: ONNX models with a card in their metadata, read so that nothing in a file can run.

What plays our own networks is in `policies.network`; what is made elsewhere becomes an `ImportedPolicy`.
"""
