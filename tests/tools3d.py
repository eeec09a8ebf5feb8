"""What a browser's 3-D view first says to the server."""

import msgspec

CAMERA = msgspec.msgpack.encode(
    {
        "type": "ViewerCameraMessage",
        "wxyz": [1.0, 0.0, 0.0, 0.0],
        "position": [0.0, 0.0, 5.0],
        "fov": 0.8,
        "near": 0.01,
        "far": 1000.0,
        "image_height": 500,
        "image_width": 400,
        "look_at": [0.0, 0.0, 0.0],
        "up_direction": [0.0, 0.0, 1.0],
    }
)
