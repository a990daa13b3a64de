"""What ends a link at the drive's side."""


class BusError(Exception):
    """The bus or line cannot be served; its text is a sentence for the user."""
