"""What planners are made of: what they are told and may offer, expressions, limits, fallbacks."""
