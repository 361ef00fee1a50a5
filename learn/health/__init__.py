"""What a log says of a vehicle without any model of it: `wrenchgap check`.

rotors      where the rotors are, and what share of the thrust each is commanded
phases      ground, take-off, hover, moving flight, landing, crash
motors      balance in hover, saturation
vibration   levels, clipping, and the peaks that belong to rotors
battery     voltage, sag
estimator   test ratios of the innovations
answers     what the log can answer, and which setting of the logger would change that
health      all of it, of one log or several
"""
