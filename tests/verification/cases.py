"""All verification cases, in the order of the table."""

from __future__ import annotations

from verification import (
    branches,
    conservation,
    free_block,
    manufactured,
    membrane,
    membrane_laws,
    mesh_convergence,
    sphere,
    strips,
    viscous,
)
from verification.table import Case

CASES = (
    Case("free_block-neo_hookean", free_block.neo_hookean),
    Case("free_block-mooney_rivlin", free_block.mooney_rivlin),
    Case("free_block-gent", free_block.gent),
    Case("free_block-permittivity", free_block.permittivity),
    Case("branch-neo_hookean", branches.neo_hookean),
    Case("branch-mooney_rivlin", branches.mooney_rivlin),
    Case("branch-membrane", branches.membrane, slow=True),
    Case("membrane-tabulated", membrane.tabulated, slow=True),
    Case("membrane-voltage", membrane.voltage),
    Case("membrane-no_voltage", membrane.no_voltage, slow=True),
    Case("membrane-incompressible", membrane.incompressible),
    Case("membrane-narrow", membrane.narrow, slow=True),
    Case("membrane-mooney_rivlin", membrane.mooney_rivlin, slow=True),
    Case("membrane-electrodes", membrane.electrodes, slow=True),
    Case("membrane-thick_electrodes", membrane.thick_electrodes, slow=True),
    Case("membrane-yeoh_permittivity", membrane_laws.elastosil, slow=True),
    Case("membrane-gent", membrane_laws.gent, slow=True),
    Case("membrane-ogden", membrane_laws.ogden, slow=True),
    Case("strips-in_air", strips.in_air, slow=True),
    Case("strips-air_stiffness", strips.air_stiffness, slow=True),
    Case("sphere", sphere.rows),
    Case("conservation-derivatives", conservation.derivatives),
    Case("conservation-permittivity", conservation.by_stretch),
    Case("conservation-cycle", conservation.cycle),
    Case("manufactured-neo_hookean", manufactured.neo_hookean, slow=True),
    Case("manufactured-mooney_rivlin", manufactured.mooney_rivlin, slow=True),
    Case("manufactured-linear", manufactured.linear, slow=True),
    Case("manufactured-mixed", manufactured.mixed, slow=True),
    Case("mesh_convergence", mesh_convergence.rows),
    Case("viscous-relaxation", viscous.relaxation),
    Case("viscous-large_strain", viscous.large_strain),
    Case("viscous-loops", viscous.loops, slow=True),
    Case("viscous-pull_in", viscous.vhb, slow=True),
)
