"""Fitting: all parameters of a model from any mixture of measurements, and what they leave open.

Public: `fit.fit`, `fit.FitResult`.
"""
