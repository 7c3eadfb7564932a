"""The ground floor: how vehicles move, what is known of them, when ranges come; each formula once, as a CasADi expression."""
