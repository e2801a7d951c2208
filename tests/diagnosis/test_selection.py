"""Selection of atoms on a Gram matrix, beside the sum over all models."""

from itertools import product

import numpy as np
import pytest

from excite.diagnosis.selection.sampler import AtomPrior, Problem, draw_models, find_mode, gains_beside

# Groups of atoms by the number of their columns.
WIDTHS = ((1, 2), (3,), (1, 1, 2), (2,), (1, 3))


def make_problem(seed: int, bounded: bool = False) -> Problem:
    """Noise and the columns of two of the groups, of which one is much like a third's."""
    rng = np.random.default_rng(seed)
    widths = [width for group in WIDTHS for width in group]
    columns = rng.normal(size=(60, sum(widths))) @ np.diag(rng.uniform(0.01, 30.0, sum(widths)))
    columns[:, 0] = 0.3 * columns[:, 6] + 0.1 * columns[:, 0]
    y = columns[:, 6] / np.linalg.norm(columns[:, 6]) * 5.0 + rng.normal(size=60)
    y += 6.0 * columns[:, 3] / np.linalg.norm(columns[:, 3])
    atoms = []
    for width in widths:
        low = np.full(width, 0.0 if bounded else -np.inf)
        atoms.append(
            AtomPrior(np.zeros(width), rng.uniform(0.5, 2.0, width), low, np.full(width, np.inf), -1.0)
        )
    group = np.repeat(np.arange(len(WIDTHS)), [len(widths) for widths in WIDTHS])
    needs = np.full(len(WIDTHS), -1)
    return Problem.of_atoms(atoms, group, needs, columns.T @ columns, columns.T @ y)


def log_posterior(problem: Problem, state: tuple[int, ...]) -> float:
    """½ hᵀ Λ⁻¹ h − ½ log|Λ| + ½ log|P| + Σ c + prior odds."""
    spans = [np.arange(problem.first[a], problem.first[a] + problem.width[a]) for a in state if a >= 0]
    s = np.concatenate([np.arange(0), *spans])
    precision = problem.gram[np.ix_(s, s)] + np.diag(problem.precision[s])
    value = 0.5 * problem.right[s] @ np.linalg.solve(precision, problem.right[s])
    value += 0.5 * np.log(problem.precision[s]).sum() + problem.constant[s].sum()
    return value - 0.5 * np.linalg.slogdet(precision)[1] + sum(problem.log_prior[a] for a in state if a >= 0)


def all_models(problem: Problem) -> list[tuple[int, ...]]:
    choices = [
        [-1, *range(begin, begin + n)] for begin, n in zip(problem.begin, problem.n_atoms, strict=True)
    ]
    return list(product(*choices))


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_frequencies_of_models_are_those_of_the_sum_over_all(seed):
    problem = make_problem(seed)
    models = all_models(problem)
    values = np.array([log_posterior(problem, model) for model in models])
    odds = np.exp(values - values.max())
    inside = np.array(models) >= 0
    expected = odds @ inside / odds.sum()

    start = np.full(len(WIDTHS), -1)
    draws = draw_models(problem, start, 2000, 100, np.random.default_rng(seed))

    assert draws.inclusion == pytest.approx(expected, abs=0.03)
    assert (draws.states >= 0).mean(axis=0) == pytest.approx(expected, abs=0.05)
    assert tuple(draws.best) == models[int(values.argmax())]
    assert log_posterior(problem, tuple(find_mode(problem, start))) > values.max() - 3.0


@pytest.mark.parametrize("seed", [3, 4])
def test_what_an_atom_gains_is_the_difference_of_two_posteriors(seed):
    problem = make_problem(seed)
    for state in [(-1,) * 5, (0, 2, -1, -1, -1), (-1, 2, 4, 6, -1)]:
        gains = gains_beside(problem, np.array(state))
        for atom, group in enumerate(problem.group):
            if state[group] < 0:
                with_it = (*state[:group], atom, *state[group + 1 :])
                difference = log_posterior(problem, with_it) - log_posterior(problem, state)
                assert gains[atom] == pytest.approx(difference, abs=1e-8)


def test_a_size_stays_within_its_bounds():
    problem = make_problem(5, bounded=True)
    draws = draw_models(problem, np.full(len(WIDTHS), -1), 200, 20, np.random.default_rng(5))
    for state in draws.states:
        spans = [np.arange(problem.first[a], problem.first[a] + problem.width[a]) for a in state if a >= 0]
        s = np.concatenate([np.arange(0), *spans])
        precision = problem.gram[np.ix_(s, s)] + np.diag(problem.precision[s])
        sizes = np.linalg.solve(precision, problem.right[s])
        assert (sizes > -3.5 * np.sqrt(np.diag(np.linalg.inv(precision)))).all()
