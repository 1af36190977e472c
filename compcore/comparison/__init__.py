"""Comparison: a model beside measurements, where and when it is wrong.

Public: `compare.compare`, `compare.Comparison`.
"""
