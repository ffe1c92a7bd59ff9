"""Method ``profile``, the default: a drive matched, smoothed along its path, handed on as factors of its passes."""
