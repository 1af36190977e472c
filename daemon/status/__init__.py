"""What a run says of itself: its status, made when somebody asks for it, and its figures."""
