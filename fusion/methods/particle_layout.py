"""How the particle cloud and its sums are laid out in arrays, for the kernels and those who call them."""

from fusion.methods.kinematics import STATES

BLOCK = 2048

# Columns of the first pass's sums.
A_LOGMAX, A_W, A_X, A_Y, A_T, A_XX, A_YY, A_TT, A_XY, A_XT, A_YT = range(11)
A_COLUMNS = 11
# Columns of the second pass's sums: the states' means stand at B_STATE + row.
B_LOGMAX, B_W, B_WW, B_COS, B_SIN, B_PITCH, B_PITCH2, B_XX, B_YY, B_ZZ, B_STATE = range(11)
B_COLUMNS = B_STATE + STATES
