"""`pmsm-bench export-c`: the windowed estimator as a C99 module in a folder of its own."""

from pathlib import Path

from bench.cli.output import as_refusal, write_whole
from bench.errors import ConfigError
from estimator.export_c.module import module_of, page, sources
from estimator.export_c.vectors import header


def run(window: int, parameters: str, kind: str, out: Path, *, force: bool) -> None:
    """Write the module's files, its vectors and its page."""
    try:
        module = module_of(window, [name.strip() for name in parameters.split(",") if name.strip()], kind)
    except ValueError as error:
        raise ConfigError(str(error)) from None
    _check_folder(out, force=force)
    files = {**sources(module), "pmsm_vectors.h": header(module), "README.md": page(module)}
    for name, text in files.items():
        with as_refusal(out / name):
            write_whole(out / name, text, over=force)
    what = f"{', '.join(module.estimated)} by the last {window} samples in {kind}"
    print(f"{out}: {what}, {module.bytes} bytes of static memory; next: read {out / 'README.md'}")


def _check_folder(out: Path, *, force: bool) -> None:
    """Make the folder. Raises ConfigError where it has something in it that is not to be written over."""
    with as_refusal(out):
        if out.is_dir() and not force and any(out.iterdir()):
            raise ConfigError(f"--out: {out} has files in it already, expected a new or an empty folder, or --force")
        out.mkdir(parents=True, exist_ok=True)
