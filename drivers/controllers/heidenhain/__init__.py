"""Heidenhain: position displays ND, controls TNC (COM and CMA tables, KinematicsComp)."""
