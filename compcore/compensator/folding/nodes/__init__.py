"""Nodes: the variables of folded tables, where their nodes stand, and the rows at them."""
