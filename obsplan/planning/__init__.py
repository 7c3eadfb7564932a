"""What planners are made of: what they are told, what they may offer, expressions, limits and fallbacks."""
