"""`python -m tests.gallery`: the pictures and their page, index.html, in build/gallery."""

from pathlib import Path

from tests.gallery import PICTURES
from tests.gallery.page import page
from tests.gallery.picture import save

OUT = Path("build") / "gallery"


def main() -> None:
    """All of it; takes about a minute."""
    for n, (name, picture) in enumerate(PICTURES.items(), 1):
        print(f"{n:2} of {len(PICTURES)}  {picture.title}", flush=True)
        save(picture, OUT / f"{name}.png")
    (OUT / "index.html").write_text(page(PICTURES), encoding="utf-8")
    print(f"{OUT}/index.html shows them")


if __name__ == "__main__":
    main()
