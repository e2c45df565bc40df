"""Which roundings this machine makes: elementary functions and BLAS differ from CPU to CPU."""

import hashlib

import numpy as np
from scipy.linalg import expm


def fingerprint() -> str:
    """SHA-256 of what this machine's NumPy and SciPy return for fixed inputs."""
    generator = np.random.default_rng(0)
    results = hashlib.sha256()
    values = generator.uniform(0.01, 3.0, 1001)
    for result in (np.log(values), np.exp(values), np.power(values, 0.3)):
        results.update(result.tobytes())
    for size in range(1, 13):
        matrix, vector = generator.normal(size=(size, size)), generator.normal(size=size)
        results.update((matrix @ vector).tobytes())
        results.update((matrix @ matrix.T).tobytes())
        results.update(expm(matrix).tobytes())
        results.update(np.linalg.eig(matrix).eigenvalues.tobytes())
    return results.hexdigest()
