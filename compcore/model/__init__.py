"""Models: a machine plus effects with parameter values, and what they predict.

Public: `model.Model`, `sensitivity.prediction_sd`.
"""
