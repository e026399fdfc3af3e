"""The orbit model: parametrization, observations, projection."""
