GET /page HTTP/1.1
Host: 127.0.0.1:8650
Upgrade: websocket
Connection: upgrade
Sec-WebSocket-Version: 13
Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==

Å≠z wkjgm&;"!4132631005762754<9;:e``agbfgadde&|Å©z j`#8#5-"!ldcq`^op&;"3(! lvegq&;"!wums&|Å®z j`#8#6-"!ldcq`^op&;"3(! lvegq&;"!eso!yÅ»z j`#8#7-"!ldcq`^op&;"3(! lvegq&;"!wdv!(! melg!>! SME]HT#.#&wcoqd 9$0,6yÅ“z j`#8#0-"!ldcq`^op&;"3(! lvegq&;"!vdcg)gkoa#.#&ug{p#8#&QKG[JR#5/7_jQKG[JF#4/0_j#ÅØz j`#8#1-"!ldcq`^op&;"3(! lvegq&;"!sskwa,djhd ~Å∑z j`#8#2-"!ldcq`^op&;"3(! lvegq&;"!wugs&-"!wdaljeq!>!1~Å©z j`#8#3-"!ldcq`^op&;"3(! lvegq&;"!lnng&|Åªz j`#8#<-"!ldcq`^op&;"3(! lvegq&;"!gikqt#.#&rg`kofp&;"mqmn~Åæz j`#8#=-"!ldcq`^op&;"3(! lvegq&;"!vhe!(! bguklj#8#&ukop!2-6#