"""Policy files: ONNX models with a card in their metadata. Nothing in them runs.

`policies.network` plays our own networks; models of other libraries become an `ImportedPolicy`.
"""
