"""Elements of a vector picture. Positions are px, to a tenth. Knows nothing of what is drawn."""

from dataclasses import dataclass

from markupsafe import Markup, escape


@dataclass(frozen=True, slots=True)
class Box:
    """An upright rectangle; px."""

    left: float
    top: float
    right: float
    bottom: float

    @property
    def middle(self) -> tuple[float, float]:
        """Its centre."""
        return (self.left + self.right) / 2, (self.top + self.bottom) / 2


def tag(name: str, *inside: str, **attributes: str | float) -> Markup:
    """An element; `class_` and `aria_label` are the attributes class and aria-label. What is no markup is escaped."""
    told = "".join(f' {key.rstrip("_").replace("_", "-")}="{_value(value)}"' for key, value in attributes.items())
    content = Markup("").join(inside)
    return Markup(f"<{name}{told}>{content}</{name}>" if content else f"<{name}{told}/>")


def text(said: str, x: float, y: float, looks: str) -> Markup:
    """Words whose baseline is at y."""
    return tag("text", said, class_=looks, x=x, y=y)


def upwards(said: str, x: float, y: float, looks: str) -> Markup:
    """Words that are read from the right, their middle at x, y."""
    return tag("text", said, class_=f"{looks} middle", transform=f"translate({px(x)} {px(y)}) rotate(-90)")


def px(value: float) -> str:
    """A position."""
    return f"{value:.1f}".removesuffix(".0")


def _value(value: str | float) -> str:
    return escape(value) if isinstance(value, str) else px(value)
