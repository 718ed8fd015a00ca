GET /page HTTP/1.1
Host: 127.0.0.1:8650
Upgrade: websocket
Connection: upgrade
Sec-WebSocket-Version: 13
Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==

âz wkjgm&;Ä£#2350017267144536:;=8cbfca``egfbg ~âÄÅ©z j`#8#5-"!ldcq`^op&;"3(! lvegq&;"!wums&|àÉ¡´