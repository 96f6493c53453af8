"""Writes ``.fit`` files, which the package only reads."""

from fapengine.codec.fit import Fit


def format_fit(table: Fit) -> bytes:
    """Write the text of a ``.fit`` file; :func:`parse_fit` reads it back."""
    lines = [[len(table.nodes)], *([len(node), *node] for node in table.nodes), [len(table.links)]]
    for link in table.links:
        lines.append([link.parent, link.child, link.priority])
        for polynomial in (side for pair in link.quotients for side in pair):
            line = [len(polynomial.terms)]
            if polynomial.terms:
                line.append(polynomial.divisor)
            for term in polynomial.terms:
                line += [int(term.coefficient < 0), abs(term.coefficient), len(term.powers)]
                line += [number for power in term.powers for number in power]
            lines.append(line)
    return "".join(" ".join(map(str, line)) + "\n" for line in lines).encode()
