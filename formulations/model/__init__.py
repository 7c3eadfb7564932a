"""The ground floor: how vehicles move, what is known of them, when ranges come.

Each formula once, as a CasADi expression.
"""
