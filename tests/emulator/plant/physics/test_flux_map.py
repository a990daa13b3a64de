"""A flux map from tabled points: what it tells between them, and what it refuses."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from emulator.bounds import ScenarioError
from emulator.plant.physics.flux_map import energy, fitted, gradient, hessian, loaded, misfit
from emulator.scenario.scenarios import parse
from tests.peers.saturated import baldor_current, tabled

L_d, L_q, psi_f = 18e-3, 110e-3, 0.47


def linear_points(points: int = 12, L_q: float = L_q) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
    """Current and flux linkage of a machine that does not saturate, i_q of either sign."""
    i_d, i_q = np.meshgrid(np.linspace(-10.0, 8.0, points), np.linspace(-10.0, 10.0, points))
    return i_d + 1j * i_q, psi_f + L_d * i_d + 1j * L_q * i_q


def test_a_machine_that_does_not_saturate_is_told_exactly() -> None:
    i, psi = linear_points()
    flux_map = fitted(i.ravel(), psi.ravel())
    assert misfit(flux_map, i, psi) < 1e-9  # A
    assert flux_map.psi_f == pytest.approx(psi_f, rel=1e-10)
    by_d, by_q, across = hessian(flux_map, complex(psi_f, 0.3))
    assert (by_d, by_q) == pytest.approx((1.0 / L_d, 1.0 / L_q), rel=1e-6)
    assert abs(across) < 1e-6 / L_q


def test_a_finer_table_of_a_saturated_machine_makes_a_finer_map() -> None:
    """From 10 to 20 cells an axis: the current is of third order in their size."""
    i, psi = tabled(33)
    coarse, fine = (misfit(fitted(*(part.ravel() for part in tabled(points))), i, psi) for points in (21, 41))
    rms = float(np.sqrt(np.mean(np.abs(i) ** 2)))
    assert fine < 3e-4 * rms
    assert 6.0 < coarse / fine < 10.0


def test_current_is_the_slope_of_the_energy_and_the_same_for_either_sign_of_the_quadrature_axis() -> None:
    flux_map = fitted(*(part.ravel() for part in tabled()))
    h = 1e-5  # Vs
    for psi in (0.45 + 0.2j, 0.31 + 0.97j, 0.6 - 0.5j):
        slope = complex(
            energy(flux_map, psi + h) - energy(flux_map, psi - h),
            energy(flux_map, psi + 1j * h) - energy(flux_map, psi - 1j * h),
        ) / (2.0 * h)
        assert gradient(flux_map, psi) == pytest.approx(slope, abs=1e-5)
        assert gradient(flux_map, psi.conjugate()) == pytest.approx(gradient(flux_map, psi).conjugate(), abs=1e-12)
        assert gradient(flux_map, psi) == pytest.approx(complex(baldor_current(psi)), abs=0.01)


def saved(folder: Path, **arrays: NDArray[Any]) -> Path:
    file = folder / "map.npz"
    np.savez(file, allow_pickle=False, **arrays)
    return file


def test_a_file_that_is_no_flux_map_is_refused_in_a_sentence(tmp_path: Path) -> None:
    i, psi = linear_points()
    with pytest.raises(ValueError, match=r"no such file: .*absent\.npz"):
        loaded(tmp_path / "absent.npz")
    with pytest.raises(ValueError, match=r"map\.npz takes the arrays i_s_dq and psi_s_dq, psi_s_dq is missing"):
        loaded(saved(tmp_path, i_s_dq=i))
    with pytest.raises(ValueError, match="as many of current as of flux, got 144 and 143"):
        loaded(saved(tmp_path, i_s_dq=i, psi_s_dq=psi.ravel()[1:]))
    with pytest.raises(ValueError, match="at least 16 finite points"):
        loaded(saved(tmp_path, i_s_dq=i * np.nan, psi_s_dq=psi))
    whole = saved(tmp_path, i_s_dq=i, psi_s_dq=psi).read_bytes()
    for content in (b"", b"no archive", whole[:-40]):
        (tmp_path / "other.npz").write_bytes(content)
        with pytest.raises(ValueError, match=r"other\.npz is no \.npz file"):
            loaded(tmp_path / "other.npz")


def test_a_map_whose_current_does_not_follow_from_flux_is_refused(tmp_path: Path) -> None:
    i, psi = linear_points(L_q=-L_q)
    with pytest.raises(ValueError, match="a flux map takes inductances above zero everywhere"):
        loaded(saved(tmp_path, i_s_dq=i, psi_s_dq=psi))
    with pytest.raises(ValueError, match="points that differ on both axes"):
        loaded(saved(tmp_path, i_s_dq=i, psi_s_dq=np.real(psi) + 0j))


def test_a_scenario_whose_map_cannot_be_is_refused_naming_file_and_key(tmp_path: Path) -> None:
    saved(tmp_path, **dict(zip(("i_s_dq", "psi_s_dq"), linear_points(L_q=-L_q), strict=True)))
    motor = '[motor]\nname = "baldor_ecs101m"\n[effects.flux_map]\nfile = "{}"\n'
    with pytest.raises(ScenarioError, match=r"here\.toml: effects\.flux_map\.file: no such file: .*absent\.npz"):
        parse(motor.format("absent.npz"), "here.toml", tmp_path)
    with pytest.raises(ScenarioError, match=r"here\.toml: effects\.flux_map\.file: a flux map takes inductances above"):
        parse(motor.format("map.npz"), "here.toml", tmp_path)
    with pytest.raises(ScenarioError, match=r"here\.toml: effects\.saturation takes no size beside effects\.flux_map"):
        parse(motor.format("map.npz") + "[effects.saturation]\nL_q_drop = 0.1\n", "here.toml", tmp_path)
