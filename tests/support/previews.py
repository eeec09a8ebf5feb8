"""What a chat program reads of a page to show a preview of its link."""

import re
from io import BytesIO

from PIL import Image

TAG = re.compile(r'<meta (?:property|name)="([^"]+)" content="([^"]*)">')


def tags(page):
    """The named tags of a page."""
    return dict(TAG.findall(page.text))


def picture_of(client, preview, site):
    """The size of the picture that a preview names, fetched by its address."""
    picture = client.get(preview["og:image"].replace(site, ""))
    assert picture.headers["cross-origin-resource-policy"] == "cross-origin"
    size = (int(preview["og:image:width"]), int(preview["og:image:height"]))
    assert Image.open(BytesIO(picture.content)).size == size
    return size
