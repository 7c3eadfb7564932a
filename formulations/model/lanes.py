"""C of an expression for several cases side by side: a processor's vectors hold one case a lane.

Each operation of the expression's Function becomes one of a whole vector, in the same order:
every lane has the bits of the Function itself.
"""

from collections.abc import Collection

import casadi as ca

# Operations on vectors and on plain numbers alike.
PLAIN = {
    ca.OP_ASSIGN: "{0}",
    ca.OP_ADD: "{0} + {1}",
    ca.OP_SUB: "{0} - {1}",
    ca.OP_MUL: "{0} * {1}",
    ca.OP_DIV: "{0} / {1}",
    ca.OP_NEG: "-{0}",
    ca.OP_SQ: "{0} * {0}",
    ca.OP_TWICE: "2.0 * {0}",
    ca.OP_INV: "1.0 / {0}",
}
# Those that have a function in C, by the number of its arguments; vectors ask it lane by lane
# unless they have their own.
CALLED = {
    1: {
        ca.OP_SQRT: "sqrt",
        ca.OP_EXP: "exp",
        ca.OP_LOG: "log",
        ca.OP_SIN: "sin",
        ca.OP_COS: "cos",
        ca.OP_FABS: "fabs",
        ca.OP_NOT: "is_zero",
    },
    2: {
        ca.OP_FMAX: "fmax",
        ca.OP_FMIN: "fmin",
        ca.OP_POW: "pow",
        ca.OP_CONSTPOW: "pow",
        ca.OP_ATAN2: "atan2",
        ca.OP_LT: "is_less",
        ca.OP_LE: "is_at_most",
        ca.OP_EQ: "is_equal",
        ca.OP_NE: "is_other",
        ca.OP_AND: "both",
        ca.OP_OR: "either",
        ca.OP_IF_ELSE_ZERO: "where",
    },
}

LANES = 4  # what two vectors of SSE2 or NEON hold, and one of AVX
VECTORS = """
#pragma GCC diagnostic ignored "-Wpsabi" /* vectors are handed over within this file alone */
#include <math.h>
#include <stdint.h>
#include <string.h>
#define LANES 4
typedef double lanes __attribute__((vector_size(8 * LANES), may_alias));
typedef int64_t choice __attribute__((vector_size(8 * LANES)));
#define INLINE static inline __attribute__((always_inline))
INLINE lanes all(double x) { return (lanes){x, x, x, x}; }
/* as C's, not lane by lane: what is no number is never the greater */
INLINE lanes lanes_fmax(lanes x, lanes y) {
  choice first = (choice)(x > y) | (choice)(y != y);
  return (lanes)((first & (choice)x) | (~first & (choice)y));
}
#ifdef __SSE2__
#include <emmintrin.h>
/* rounded correctly, as C's */
INLINE lanes lanes_sqrt(lanes x) {
  const __m128d low = _mm_sqrt_pd((__m128d){x[0], x[1]});
  const __m128d high = _mm_sqrt_pd((__m128d){x[2], x[3]});
  return (lanes){low[0], low[1], high[0], high[1]};
}
#else
INLINE lanes lanes_sqrt(lanes x) { return (lanes){sqrt(x[0]), sqrt(x[1]), sqrt(x[2]), sqrt(x[3])}; }
#endif
INLINE double is_zero(double x) { return x == 0; }
INLINE double is_less(double x, double y) { return x < y; }
INLINE double is_at_most(double x, double y) { return x <= y; }
INLINE double is_equal(double x, double y) { return x == y; }
INLINE double is_other(double x, double y) { return x != y; }
INLINE double both(double x, double y) { return x && y; }
INLINE double either(double x, double y) { return x || y; }
INLINE double where(double x, double y) { return x ? y : 0.0; }
INLINE lanes lanes_is_zero(lanes x) { return (lanes)((choice)(x == 0) & (choice)all(1.0)); }
INLINE lanes lanes_is_less(lanes x, lanes y) {
  return (lanes)((choice)(x < y) & (choice)all(1.0));
}
INLINE lanes lanes_is_at_most(lanes x, lanes y) {
  return (lanes)((choice)(x <= y) & (choice)all(1.0));
}
INLINE lanes lanes_where(lanes x, lanes y) { return (lanes)((choice)(x != 0) & (choice)y); }
/* stages mostly have one range, and the power 1 the same bits */
INLINE lanes lanes_pow(lanes x, lanes y) {
  if (y[0] == 1 && y[1] == 1 && y[2] == 1 && y[3] == 1) return x;
  return (lanes){pow(x[0], y[0]), pow(x[1], y[1]), pow(x[2], y[2]), pow(x[3], y[3])};
}
"""
OF_VECTORS = {"fmax", "sqrt", "is_zero", "is_less", "is_at_most", "where", "pow"}  # written above


def vectors() -> str:
    """C of what `in_lanes` uses, to stand before it."""
    one = "INLINE lanes lanes_{0}(lanes x) {{ return (lanes){{{1}}}; }}"
    two = "INLINE lanes lanes_{0}(lanes x, lanes y) {{ return (lanes){{{1}}}; }}"
    lines = [VECTORS]
    for name in sorted(set(CALLED[1].values()) - OF_VECTORS):
        each = ", ".join(f"{name}(x[{i}])" for i in range(LANES))
        lines.append(one.format(name, each))
    for name in sorted(set(CALLED[2].values()) - OF_VECTORS):
        each = ", ".join(f"{name}(x[{i}], y[{i}])" for i in range(LANES))
        lines.append(two.format(name, each))
    return "\n".join([*lines, ""])


def in_lanes(function: ca.Function, *, shared: Collection[int] = ()) -> str:
    """C of a Function of scalars (SX): its name, inputs and outputs, pointers to vectors.

    Inputs that are ``shared`` are plain numbers, the same for each case. Results whose pointer is 0
    are not wanted, and a compiler leaves out what only they need.

    Raises
    ------
    KeyError
        An operation that is not in the tables above.
    """
    kinds = ["double" if i in shared else "lanes" for i in range(function.n_in())]
    given = [f"const {kind}* a{i}" for i, kind in enumerate(kinds)]
    found = [f"lanes* r{i}" for i in range(function.n_out())]
    lines = [f"INLINE void {function.name()}({', '.join(given + found)}) {{"]
    names: dict[int, str] = {}  # where a result is kept -> the last one that was kept there
    plain: set[str] = set()  # names of numbers that are the same for each case
    for k in range(function.n_instructions()):
        operation, to = function.instruction_id(k), function.instruction_output(k)
        of = function.instruction_input(k)
        if operation == ca.OP_OUTPUT:
            value = names[of[0]]
            value = f"all({value})" if value in plain else value
            lines.append(f"  if (r{to[0]}) r{to[0]}[{to[1]}] = {value};")
            continue
        arguments = [] if operation in (ca.OP_INPUT, ca.OP_CONST) else [names[i] for i in of]
        alike = plain.issuperset(arguments)
        if operation == ca.OP_INPUT:
            value, alike = f"a{of[0]}[{of[1]}]", of[0] in shared
        elif operation == ca.OP_CONST:
            value = float(function.instruction_constant(k)).hex()
        else:
            value = _operation(operation, arguments, plain)
        name_of_result = f"x{k}"
        names[to[0]] = name_of_result
        if alike:
            plain.add(name_of_result)
        lines.append(f"  {'double' if alike else 'lanes'} {name_of_result} = {value};")
    return "\n".join([*lines, "}", ""])


def _operation(operation: int, arguments: list[str], plain: set[str]) -> str:
    """An operation as C, of vectors unless all arguments are plain numbers."""
    if plain.issuperset(arguments):
        vectors, prefix = arguments, ""
    else:
        vectors, prefix = [f"all({a})" if a in plain else a for a in arguments], "lanes_"
    called = CALLED[len(arguments)].get(operation)
    if called is not None:
        return f"{prefix}{called}({', '.join(vectors)})"
    return PLAIN[operation].format(*vectors)
