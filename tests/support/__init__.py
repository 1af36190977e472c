"""What tests share: cases, models, peers and processes, by what they are for."""
