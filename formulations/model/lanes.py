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
# Those that have a function for each; see `VECTORS`.
CALLED = {ca.OP_FMAX: "fmax", ca.OP_LOG: "log", ca.OP_SIN: "sin", ca.OP_COS: "cos"}

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
INLINE lanes lanes_log(lanes x) { return (lanes){log(x[0]), log(x[1]), log(x[2]), log(x[3])}; }
INLINE lanes lanes_sin(lanes x) { return (lanes){sin(x[0]), sin(x[1]), sin(x[2]), sin(x[3])}; }
INLINE lanes lanes_cos(lanes x) { return (lanes){cos(x[0]), cos(x[1]), cos(x[2]), cos(x[3])}; }
/* as C's fmax: what is no number is never the greater */
INLINE lanes lanes_fmax(lanes x, lanes y) {
  choice first = (choice)(x > y) | (choice)(y != y);
  return (lanes)((first & (choice)x) | (~first & (choice)y));
}
"""


def in_lanes(function: ca.Function, *, shared: Collection[int] = (), name: str = "") -> str:
    """C of a Function of scalars (SX): ``name(inputs..., outputs...)``, pointers to vectors.

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
    lines = [f"INLINE void {name or function.name()}({', '.join(given + found)}) {{"]
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
    if operation in CALLED:
        return f"{prefix}{CALLED[operation]}({', '.join(vectors)})"
    return PLAIN[operation].format(*vectors)
