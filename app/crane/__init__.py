"""The waste-scattering world: a crane whose claws open and close over a pit (paper, Sec. V)."""
