"""What a campaign does not determine: the null space, by fewest effects, in words."""
