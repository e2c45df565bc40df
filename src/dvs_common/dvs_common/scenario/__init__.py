"""The scenario: parameters, their schema, parameter files and the model types they describe."""
