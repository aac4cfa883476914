"""Contact Mechanics Challenge without adhesion, from first touch to full contact.

Run by ``run/challenge``; see there.

References
----------
M.H. Müser, W.B. Dapp et al., Meeting the contact-mechanics challenge, Tribol. Lett. 65 (2017) 118.
N. Prodanov, W.B. Dapp, M.H. Müser, On the contact area and mean gap of rough, elastic contacts, Tribol. Lett. 53 (2014)
433: without adhesion.
B.N.J. Persson, Theory of rubber friction and contact mechanics, J. Chem. Phys. 115 (2001) 3840.
A.W. Bush, R.D. Gibson, T.R. Thomas, The elastic contact of a rough surface, Wear 35 (1975) 87.
V.A. Yastrebov, G. Anciaux, J.-F. Molinari, On the accurate computation of the true contact-area in mechanical contact
of random rough surfaces, Tribol. Int. 114 (2017) 161.
"""
