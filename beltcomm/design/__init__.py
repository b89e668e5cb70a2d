"""From a plant to a controller: prefilter, velocity PI, position gain, feedforward, and the proof of their margins.

- ``design_plant``: the plant as a value, sampled as the drive samples it
- ``prefilters``: notch and Butterworth, (4.1) to (4.4)
- ``thesis``: the design as printed, (4.5) to (4.14), for comparison
- ``knobs``: the thesis's three tuning knobs, there and back
- ``conversion``: a cascade as a PID controller and back, appendix B
- ``specification``: what is asked of a loop, and the refusal
- ``loops``: open and closed loops as the drive runs them
- ``margins``: what a given cascade achieves
- ``search``: the gains with the largest K_I K_PP within the conditions
- ``cascade``: the product's design
- ``cautious``: the first loop, closed right after the first frequency response
- ``feedforward``: (4.15) to (4.17)
"""
