"""Positions from pseudoranges by Viandier 2011: filters, laws of the errors, and how well a law holds.

``particles`` is the particle filter (Algorithms 6 to 8), ``jms_gmm`` its mixture of normals by state of reception
(4.2, Algorithm 10) over ``gmm``, ``rbpf_dpm`` the filter with Dirichlet processes (Tables 3.9 and 3.11) over ``dpm``.
``particles_bank`` and ``particles_each`` lead them. ``laws`` are the laws of pseudorange errors and their tests,
``study`` says what the residuals of a drive look like.
"""
